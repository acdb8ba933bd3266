"""Pages that lead from one assembly to the next, in a browser: each that `modes` finds, and the motion from there."""

import jax.numpy as jnp
import numpy as np
import pytest
from pages import CHROMIUM, Browser

import jaxnc as nc

driven = pytest.mark.skipif(CHROMIUM is None, reason="no Chromium, so pages are not tried in a browser")
PHI = np.radians(np.arange(115.0, 200.0, 3.0))
AT = 14  # 157°, where there are six


@pytest.fixture(scope="module")
def motion():
    """A six-bar of Stephenson's third kind, driven at its outer dyad, on its drawing's branch."""
    m = nc.Mechanism("six-bar")
    for name, at in {"A": (0, 0), "D": (3, 0.2), "G": (4.8, 1.5)}.items():
        m.ground(name, at)
    for name, at in {"B": (0.5, 1.1), "C": (2.9, 1.9), "E": (1.9, 2.9), "F": (4.1, 2.8)}.items():
        m.point(name, at)
    for body in ("AB", "BCE", "DC", "EF", "GF"):
        m.body(body, list(body))
    m.angle("phi", at="G", to="F")
    m.angle("psi", at="A", to="B")
    return nc.sweep(m.compile(), {"phi": PHI})


@pytest.fixture(scope="module")
def page(motion, tmp_path_factory):
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("JAXNC_CACHE", str(tmp_path_factory.mktemp("cache")))
        yield motion.to_html(tmp_path_factory.mktemp("modes") / "a.html", modes=True)


@pytest.fixture(scope="module")
def found(motion, page):
    return np.asarray(nc.modes(motion.system, {"phi": PHI[AT]}).poses.q)


@pytest.fixture(scope="module")
def browser(tmp_path_factory):
    started = Browser(tmp_path_factory.mktemp("chromium"))
    yield started
    started.close()


def settled(browser: Browser) -> None:
    """Wait until all curves are drawn anew, and the button says what is shown."""
    browser.frame()
    while browser.run("document.documentElement.dataset.busy") == "1":
        browser.frame()
    browser.run("new Promise(done => setTimeout(done, 400))")


def shown(browser: Browser) -> tuple[str, np.ndarray]:
    settled(browser)
    return browser.run("document.getElementById('assembly').textContent"), np.array(
        browser.run("window.jaxnc.design().q")
    )


def press(browser: Browser, way: str) -> None:
    """Press the button by mouse, finger or keyboard."""
    at = "document.getElementById('assembly')"
    if way == "key":
        browser.run(f"{at}.focus()")
        browser.key("Enter", "\r")
        return
    x, y = browser.run(f"(() => {{ const b = {at}.getBoundingClientRect(); return [b.x + 9, b.y + 9]; }})()")
    if way == "mouse":
        browser.drag((x, y), (x, y))
    else:
        browser.touch([[(x, y)], []])


def which(q: np.ndarray, found: np.ndarray) -> int:
    """Number of the assembly of `modes` that a pose is, angles in any turn."""
    off = found - q
    off[:, -2:] -= 2 * np.pi * np.round(off[:, -2:] / (2 * np.pi))
    far = np.abs(off).max(axis=1)
    assert far.min() < 1e-9
    return int(np.argmin(far))


@driven
def test_a_button_leads_through_all_assemblies_and_back(browser, motion, page, found):
    browser.open(page, f"#{AT}")
    text, begun = shown(browser)
    assert len(found) == 6 and text.endswith(" of 6")
    first, seen = int(text.split()[1]), [which(begun, found)]
    np.testing.assert_allclose(begun, np.asarray(motion.q[AT]), rtol=0, atol=1e-9)
    for k, way in enumerate(("mouse", "touch", "key", "mouse", "touch"), 1):
        press(browser, way)
        text, q = shown(browser)
        assert text == f"assembly {(first + k - 1) % 6 + 1} of 6"
        assert np.abs(q - begun)[-2:].max() < np.pi  # angles stay in their turn
        seen.append(which(q, found))
    assert sorted(seen) == list(range(6))
    press(browser, "key")
    np.testing.assert_allclose(shown(browser)[1], begun, rtol=0, atol=1e-9)
    assert browser.said == []


@driven
def test_the_motion_goes_on_in_the_assembly_that_was_chosen(browser, motion, page, found):
    """Along its branch; undo leads back."""
    browser.open(page, f"#{AT}")
    for way in ("mouse", "touch"):
        shown(browser)
        press(browser, way)
    _, q = shown(browser)
    left = "document.getElementById('drawing').getBoundingClientRect().x"
    grips = "[...document.querySelectorAll('#drawing .grip')].map(x => x.getBoundingClientRect().x)"
    assert browser.run(f"Math.min(...{grips}) - {left}") > 0.0  # the view takes it in
    start = nc.Motion(
        motion.system, motion.driven, (), jnp.asarray(q), (), motion.asked[AT], motion.status[AT], None, None
    )
    there = nc.sweep(motion.system, {"phi": PHI[[AT, AT + 1, AT + 2]]}, start=start)
    for k in (1, 2):
        browser.key("ArrowRight")
        np.testing.assert_allclose(shown(browser)[1], np.asarray(there.q[k]), rtol=0, atol=1e-9)
        assert browser.run("document.documentElement.dataset.pose") == str(AT + k)
    for _ in range(2):
        browser.run("document.getElementById('undo').click()")
        settled(browser)
    np.testing.assert_allclose(shown(browser)[1], np.asarray(motion.q[AT]), rtol=0, atol=1e-9)
    assert browser.said == []


@driven
def test_a_changed_design_has_its_own_assemblies(browser, motion, page):
    browser.open(page, f"#{AT}")
    shown(browser)
    slider = "document.querySelector('#sizes input[type=range]')"
    browser.run(f"{{ const s = {slider}; s.value = 1.02 * s.value; s.dispatchEvent(new Event('input')); }}")
    text, q = shown(browser)
    name = browser.run("document.querySelector('#sizes label').textContent")
    assert name.startswith("A–B")
    points = motion.system.topology.points
    lengths = []
    for _ in range(int(text.split()[-1])):
        at = dict(zip(points, q[: 2 * len(points)].reshape(-1, 2), strict=True))
        lengths.append([np.hypot(*(at[i] - at[j])) for i, j in ("AB", "BC", "CE", "BE", "CD", "EF", "FG")])
        press(browser, "key")
        _, q = shown(browser)
    assert len(lengths) >= 2 and np.ptp(np.array(lengths), axis=0).max() < 1e-9
    assert browser.said == []


@driven
def test_a_page_without_modes_has_no_button(browser, motion, tmp_path):
    browser.open(motion.to_html(tmp_path / "a.html"))
    assert browser.run("document.getElementById('assembly')") is None


def test_assemblies_of_something_else_are_refused(motion, page, tmp_path):
    other = nc.library.four_bar().compile()
    with pytest.raises(nc.InputError, match="assemblies of 'six-bar'"):
        motion.to_html(tmp_path / "a.html", modes=nc.modes(other, {"phi": 0.5}))
    with pytest.raises(nc.InputError, match="inputs of the motion, phi, got such for psi"):
        motion.to_html(tmp_path / "a.html", modes=nc.modes(motion.system, {"psi": 1.0}))
    with pytest.raises(nc.InputError, match=r"what jaxnc.modes found"):
        motion.to_html(tmp_path / "a.html", modes=6)
