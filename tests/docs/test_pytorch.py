"""The page on PyTorch: its fifty lines give what the library gives, and refuse what they cannot take."""

import re

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from places import DOCS

import jaxnc as nc

torch = pytest.importorskip("torch")
PAGE = (DOCS / "pytorch.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def page():
    """The names that the first block of the page makes."""
    space: dict = {"__name__": "page"}
    exec(compile(re.search(r"```python\n(.*?)```", PAGE, re.S)[1], "docs/pytorch.md", "exec"), space)
    return space


def test_values_and_gradients_are_those_of_jax(page):
    system = nc.library.four_bar().compile()

    def one(pin, angle):
        found = nc.solve_position(system.replace({"D": pin}), {"phi": angle}, throw=False, repair=False)
        return found["C"]

    f = jax.vmap(one)
    angles = np.linspace(0.1, 1.2, 4)
    pins = np.tile(np.asarray(system["D"]), (4, 1))
    tensors = torch.tensor(pins, requires_grad=True), torch.tensor(angles, requires_grad=True)
    out = page["in_torch"](f)(*tensors)
    np.testing.assert_allclose(out.detach().numpy(), f(pins, angles), atol=1e-14)
    (out[:, 0] * torch.arange(4.0).double()).sum().backward()
    by_pin, by_angle = jax.grad(lambda *x: jnp.sum(f(*x)[:, 0] * jnp.arange(4.0)), argnums=(0, 1))(pins, angles)
    np.testing.assert_allclose(tensors[0].grad.numpy(), by_pin, atol=1e-12)
    assert float(jnp.abs(by_pin[1:]).min()) > 1e-3
    np.testing.assert_allclose(tensors[1].grad.numpy(), by_angle, atol=1e-12)
    out[0, 0] = 7.0  # a tensor may be written to; the arrays of JAX stay
    assert float(f(pins, angles)[0, 0]) != 7.0


def test_tensors_of_another_type_or_device_are_refused_in_a_sentence(page):
    double = page["in_torch"](lambda x: 2.0 * x)
    x = torch.ones(3)
    with pytest.raises(nc.InputError, match=r"argument 0.*float32.*float64"):
        double(x)
    with pytest.raises(nc.InputError, match=r"argument 0.*meta.*to\('cpu'\)"):
        double(torch.ones(3, dtype=torch.float64, device="meta"))
    narrow = page["in_torch"](lambda x: 2.0 * x, torch.float32)
    assert narrow(x).dtype == torch.float32
    with pytest.raises(nc.InputError, match=r"argument 0.*float64.*float32"):
        narrow(x.double())
    with pytest.raises(nc.InputError, match=r"argument 0 is of torch\.int64"):
        double(torch.arange(3))


def test_what_is_not_differentiated_comes_along(page):
    """A second array is handed on; a penalty on a gradient would be lost without a word, and is refused."""
    both = page["in_torch"](lambda x: (x**2, x > 1.0))
    x = torch.tensor([0.5, 2.0], dtype=torch.float64, requires_grad=True)
    square, large = both(x)
    assert large.tolist() == [False, True] and not large.requires_grad
    square.sum().backward()
    np.testing.assert_array_equal(x.grad, [1.0, 4.0])
    (slope,) = torch.autograd.grad(both(x)[0].sum(), x, create_graph=True)
    with pytest.raises(nc.InputError, match="in JAX"):
        slope.sum().backward()
    with pytest.raises(nc.InputError, match="argument 0 is a list"):
        both([1.0])
