"""The page in use, in a headless Chromium."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

from cosim.case.file import load_case
from cosim.ui.desk import Desk
from cosim.ui.server import serving
from tests.helpers.chromium import CHROMIUM, Tab, chromium

pytest.importorskip("starlette")
pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(CHROMIUM is None, reason="no Chromium on the path"),
]
FLEXION = "finger.posture.PIP"
SOLVED = """fetch('/state').then((answer) => answer.json()).then((state) =>
  ['done', 'failed', 'at fault', 'waiting'].includes(state.status)
  && document.documentElement.dataset.drawn === String(state.picture) && state)"""


def slide(tab: Tab, key: str, *values: float) -> None:
    """Move the slider of a control through values, 30 ms each, and let it go."""
    tab.run(
        f"""(async () => {{
        const slider = document.querySelector('[data-key="{key}"] input[type=range]');
        for (const value of {json.dumps(values)}) {{
          slider.value = value;
          slider.dispatchEvent(new Event('input'));
          await new Promise((go) => setTimeout(go, 30));
        }}
        slider.dispatchEvent(new Event('change'));
        await new Promise((go) => setTimeout(go, 400));
        }})()"""
    )


def write(tab: Tab, key: str, text: str) -> None:
    """Write a text into the box of a control."""
    tab.run(
        f"""(async () => {{
        const box = document.querySelector('[data-key="{key}"] .value');
        box.value = {json.dumps(text)};
        box.dispatchEvent(new Event('change'));
        await new Promise((go) => setTimeout(go, 400));
        }})()"""
    )


def box(tab: Tab, key: str = FLEXION) -> str:
    return tab.run(f"document.querySelector('[data-key=\"{key}\"] .value').value")


def test_the_page_is_worked_with(tmp_path: Path) -> None:
    case = load_case("isometric_edc", ["hood.mesh.quads=150"])
    desk, said = Desk(case, tmp_path / "runs"), []
    with serving(desk, 0, False, said.append), chromium(tmp_path / "profile") as browser:
        address = said[0].split()[4]
        tab = browser.tab()
        tab.resize(1400, 1000)
        tab.open(address)
        tab.wait("document.readyState === 'complete' && location.search === ''")
        state = tab.wait(SOLVED)
        assert state["status"] == "done"
        assert tab.run("document.querySelectorAll('.pane canvas').length") >= 1

        slide(tab, FLEXION, *range(30, 80))  # fifty changes
        state = tab.wait(SOLVED)
        assert state["changes"] == {FLEXION: "79 deg"}
        assert state["answer"]["isCurrent"]

        tab.run("document.getElementById('pin').click()")
        tab.wait("document.querySelectorAll('.pane').length === 2")
        write(tab, FLEXION, "60 kg")
        tab.wait(SOLVED)
        assert "no unit of angle" in tab.run(
            "document.querySelector('.fault:not([hidden])').textContent"
        )
        write(tab, FLEXION, "60 deg")
        state = tab.wait(SOLVED)
        assert state["status"] == "done"
        assert any(row["pinned"] for row in state["strip"])

        tab.run("location.reload()")
        tab.wait("document.querySelectorAll('.control').length > 50")
        tab.wait(SOLVED)
        assert box(tab) == "60 deg"
        second = browser.tab()
        second.open(address)
        second.wait("document.querySelectorAll('.control').length > 50")
        second.bring_to_front()
        second.wait(SOLVED)
        assert box(second) == "60 deg"
        write(second, FLEXION, "50 deg")
        tab.bring_to_front()
        tab.wait(SOLVED)
        tab.wait(f"document.querySelector('[data-key=\"{FLEXION}\"] .value').value === '50 deg'")

        _rest_of_the_page(tab)
        for width in (390, 700, 1000, 1600):
            tab.resize(width, 900)
            tab.run("new Promise((go) => setTimeout(go, 400))")
            assert tab.run("document.documentElement.scrollWidth <= innerWidth"), width
        assert not tab.errors
        assert not second.errors


def _rest_of_the_page(tab: Tab) -> None:
    """Use each button and choice that is left, and a motion."""
    for look in ("radial", "dorsal", "oblique"):
        tab.run(f"document.querySelector('[data-look={look}]').click()")
    for part in range(int(tab.run("document.querySelectorAll('#parts input').length"))):
        tab.run(f"document.querySelectorAll('#parts input')[{part}].click()")
    labels = tab.run(
        "[...document.querySelectorAll('button, select, input')].filter((at) => at.offsetParent"
        " && !at.labels?.length && !at.getAttribute('aria-label') && !at.textContent.trim())"
        ".map((at) => at.outerHTML)"
    )
    assert labels == []  # of what has no name for a screen reader
    tab.run("document.getElementById('unpin').click()")
    tab.wait("document.querySelectorAll('.pane').length === 1")
    act(tab, "open", {"name": "forward_edc"})
    tab.wait(SOLVED)
    assert tab.run("document.getElementById('solve').offsetParent !== null")


def act(tab: Tab, action: str, body: dict[str, Any]) -> None:
    tab.run(
        f"fetch('/do/{action}', {{method: 'POST', body: JSON.stringify({json.dumps(body)})}})"
        ".then(() => new Promise((go) => setTimeout(go, 300)))"
    )
