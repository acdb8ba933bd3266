"""Records: what JAX takes apart, and what is part of the structure."""

import copy
import dataclasses
import pickle

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jaxnc.compiling import filter_jit, shapes_of
from jaxnc.records import record, static


@record
class Inner:
    """Two arrays."""

    a: jax.Array
    b: jax.Array | None = None


@record
class Outer:
    """A record in a record, a name, and a default."""

    name: str = static()
    inner: Inner
    more: tuple = ()
    count: int = static(default=2)

    @property
    def total(self):
        return jnp.sum(self.inner.a) * self.count


@record
class Further(Outer):
    """With one more field."""

    end: jax.Array | None = None


def made(name="one", a=(1.0, 2.0), **more) -> Outer:
    return Outer(name, Inner(jnp.array(a)), **more)


def test_arrays_are_leaves_and_static_fields_are_structure():
    leaves, structure = jax.tree.flatten(made())
    assert [x.tolist() for x in leaves] == [[1.0, 2.0]]
    assert structure == jax.tree.structure(made(a=(3.0, 4.0))) != jax.tree.structure(made("two"))
    paths = [jax.tree_util.keystr(path) for path, _ in jax.tree_util.tree_leaves_with_path(made())]
    assert paths == [".inner.a"]
    # JAX puts in what is no array: nothing is checked
    assert jax.tree.map(lambda x: "text", made()).inner.a == "text"
    assert jax.vmap(lambda o: o.total)(jax.tree.map(lambda x: jnp.stack([x, 2 * x]), made())).tolist() == [6.0, 12.0]


def test_gradient_is_a_record():
    found = jax.grad(lambda o: o.total**2)(made())
    assert type(found) is Outer and found.name == "one" and found.inner.a.tolist() == [24.0, 24.0]


def test_equality_is_of_structure_and_numbers():
    assert made() == made()
    assert made() != made("two") and made() != made(a=(1.0, 3.0)) and made() != made(a=(1.0, 2.0, 3.0))
    assert made() != made(a=(1, 2)), "of another type"
    assert made() != made(more=(1.0,)) and made() != "one" and Further("one", made().inner) != made()
    with pytest.raises(TypeError, match="unhashable"):
        hash(made())


def test_frozen_replaced_pickled_and_copied():
    one = made(more=(1.0, np.arange(2)))
    with pytest.raises(dataclasses.FrozenInstanceError):
        one.name = "two"  # pyright: ignore[reportAttributeAccessIssue]
    assert dataclasses.replace(one, count=3).total == 9.0
    for again in (pickle.loads(pickle.dumps(one)), copy.deepcopy(one), copy.copy(one)):
        assert again == one and again is not one


def test_written():
    kind = str(jnp.zeros(1).dtype)
    assert repr(made(more=(1.0,))) == (f"Outer(name='one', inner=Inner(a={kind}[2], b=None), more=(1.0,), count=2)")
    assert repr(Further("f", Inner(jnp.zeros((2, 3))))).endswith(
        f"Inner(a={kind}[2,3], b=None), more=(), count=2, end=None)"
    )


def test_what_is_no_array_is_static_and_traced_once():
    traced = []

    @filter_jit
    def scaled(o: Outer, by, how, power=1):
        traced.append(how)
        return {"x": how(o.inner.a) * by**power, "name": o}

    assert scaled(made(), 2, jnp.sin)["x"].tolist() == (2 * jnp.sin(jnp.array([1.0, 2.0]))).tolist()
    assert scaled(made(a=(3.0, 4.0)), 2, jnp.sin)["name"] == made(a=(3.0, 4.0))
    assert len(traced) == 1
    scaled(made(), 2, jnp.cos), scaled(made("two"), 2, jnp.cos), scaled(made(), 2, jnp.cos, power=2)
    assert len(traced) == 4
    assert jax.grad(lambda x: scaled(made(), x, jnp.sin)["x"].sum())(1.0) == jnp.sin(jnp.array([1.0, 2.0])).sum()


def test_shapes_without_calculating():
    def asked(o: Outer, text: str):
        return {"sum": o.total, "text": text, "o": o}

    found = shapes_of(asked, made(), "as it is")
    assert found["sum"].shape == () and found["text"] == "as it is" and found["o"].inner.a.shape == (2,)
