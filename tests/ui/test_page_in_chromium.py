"""The page in use, in a headless Chromium."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import pytest

from cosim.case.file import load_case
from cosim.ui.desk import Desk
from cosim.ui.server import serving
from tests.helpers.browser import LOOK, Browser, open_browser

pytest.importorskip("starlette")
pytestmark = pytest.mark.slow
FLEXION = "finger.posture.PIP"
SOLVED = """fetch('/state').then((answer) => answer.json()).then((state) =>
  ['done', 'failed', 'at fault', 'waiting'].includes(state.status)
  && document.documentElement.dataset.drawn === String(state.picture) && state)"""


def slide(tab: Browser, key: str, *values: float) -> None:
    """Move the slider of a control through values, 30 ms each, and let it go."""
    tab.ask(
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


def write(tab: Browser, key: str, text: str) -> None:
    """Write a text into the box of a control."""
    tab.ask(
        f"""(async () => {{
        const box = document.querySelector('[data-key="{key}"] .value');
        box.value = {json.dumps(text)};
        box.dispatchEvent(new Event('change'));
        await new Promise((go) => setTimeout(go, 400));
        }})()"""
    )


def box(tab: Browser, key: str = FLEXION) -> str:
    return tab.ask(f"document.querySelector('[data-key=\"{key}\"] .value').value")


def test_the_page_is_worked_with(tmp_path: Path) -> None:
    case = load_case("isometric_edc", ["hood.mesh.quads=150"])
    desk, said = Desk(case, tmp_path / "runs"), []
    with serving(desk, 0, False, said.append), open_browser() as tab, open_browser() as second:
        address = said[0].split()[4]
        tab.open(address, 1400, 1000)
        assert tab.ask("location.search") == ""  # the token is in a cookie
        state = tab.wait(SOLVED)
        assert state["status"] == "done"
        assert tab.ask("document.querySelectorAll('.pane canvas').length") >= 1

        slide(tab, FLEXION, *range(30, 80))  # fifty changes
        state = tab.wait(SOLVED)
        assert state["changes"] == {FLEXION: "79 deg"}
        assert state["answer"]["isCurrent"]

        tab.ask("document.getElementById('pin').click()")
        tab.wait("document.querySelectorAll('.pane').length === 2")
        write(tab, FLEXION, "60 kg")
        tab.wait(SOLVED)
        assert "no unit of angle" in tab.ask(
            "document.querySelector('.fault:not([hidden])').textContent"
        )
        tab.ask("document.getElementById('save-case').click()")
        tab.wait("document.getElementById('saved').textContent.includes('at fault')")
        write(tab, FLEXION, "60 deg")
        state = tab.wait(SOLVED)
        assert state["status"] == "done"
        assert any(row["pinned"] for row in state["strip"])

        tab.ask("location.reload()")
        tab.wait("document.querySelectorAll('.control').length > 50")
        tab.wait(SOLVED)
        assert box(tab) == "60 deg"
        second.open(address, 1400, 1000)
        second.wait("document.querySelectorAll('.control').length > 50")
        second.wait(SOLVED)
        assert box(second) == "60 deg"
        write(second, FLEXION, "50 deg")
        tab.wait(SOLVED)
        tab.wait(f"document.querySelector('[data-key=\"{FLEXION}\"] .value').value === '50 deg'")

        tab.ask(f"{LOOK};0")
        for width in (390, 700, 1000, 1600):
            tab.resize(width, 900)
            tab.ask("new Promise((go) => setTimeout(go, 600))")
            look = tab.ask("cosimTest.look()")
            assert look["fits"], width
            wrong = ("errors", "cut", "overlaps", "nameless", "unseenFocus", "outside")
            assert {key: look[key] for key in wrong if look.get(key)} == {}, width
        tab.resize(1400, 1000)
        _rest_of_the_page(tab)
        assert _errors(tab) == _errors(second) == []


def _errors(tab: Browser) -> list[str]:
    return [text for text in tab.console if re.search(r'"level": "error"|ncaught', text)]


def _rest_of_the_page(tab: Browser) -> None:
    """Use each button and choice that is left, and a motion."""
    for look in ("radial", "dorsal", "oblique"):
        tab.ask(f"document.querySelector('[data-look={look}]').click()")
    for part in range(int(tab.ask("document.querySelectorAll('#parts input').length"))):
        tab.ask(f"document.querySelectorAll('#parts input')[{part}].click()")
    tab.ask("document.getElementById('save-case').click()")
    tab.wait("document.getElementById('saved').textContent.includes('isometric_edc_changed.toml')")
    tab.ask("document.getElementById('unpin').click()")
    tab.wait("document.querySelectorAll('.pane').length === 1")
    act(tab, "open", {"name": "forward_edc"})
    tab.wait(SOLVED)
    assert tab.ask("document.getElementById('solve').offsetParent !== null")


def act(tab: Browser, action: str, body: dict[str, Any]) -> None:
    tab.ask(
        f"fetch('/do/{action}', {{method: 'POST', body: JSON.stringify({json.dumps(body)})}})"
        ".then(() => new Promise((go) => setTimeout(go, 300)))"
    )
