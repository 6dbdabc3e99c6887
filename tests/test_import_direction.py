"""Imports point one way, from what is more to what is more basic; CONTRIBUTING.md has the picture."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "coheft"
FOLDERS = [PACKAGE, *(path.resolve() for path in PACKAGE.iterdir() if path.is_symlink())]
ESTIMATION = ("errors", "estimation.")
ALLOWED = {
    "errors": (),
    "estimation.geometry": (*ESTIMATION[:1], "estimation.geometry", "estimation.linear_algebra"),
    "estimation.rigid_body": (
        *("errors", "estimation.rigid_body", "estimation.geometry"),
        *("estimation.linear_algebra", "estimation.chi_square"),
    ),
    "estimation": ESTIMATION,
    "wire": (*ESTIMATION, "wire"),
    "consensus": (*ESTIMATION, "wire", "consensus"),
    "agents": (*ESTIMATION, "wire", "consensus", "agents"),
    "physics_server": (*ESTIMATION, "wire", "physics_server"),
    "estimators": (*ESTIMATION, "wire", "consensus", "agents"),
    "app": (*ESTIMATION, "wire", "consensus", "agents", "physics_server", "app", "__version__"),
    "api": ("",),
}
"""What the parts of a package may import, by the longest beginning of a module's name; beginnings of other names."""
STRANGERS = [
    ("estimation.moments", "estimation.fan2017"),
    ("estimation.moments", "estimation.batch"),
    ("estimation.fan2017", "estimation.moments"),
    ("estimation.cart", "estimation.moments"),
    ("agents.efficient", "agents.fan2017"),
    ("agents.efficient", "agents.process"),
    ("agents.fan2017", "agents.efficient"),
    ("agents.fan2017", "agents.process"),
    ("agents.motion", "agents.efficient"),
    ("agents.cart", "agents.efficient"),
]
"""Parts that do not know of each other: the first does not import the second."""


def modules() -> dict[str, Path]:
    """All modules by their names without ``coheft.``."""
    found = {}
    for folder in FOLDERS:
        start = PACKAGE if folder == PACKAGE else folder.parent
        for path in folder.rglob("*.py"):
            parts = path.relative_to(start).with_suffix("").parts
            found[".".join(part for part in parts if part != "__init__")] = path
    return found


def imported(path: Path) -> Iterator[str]:
    """What a file imports from coheft, also inside functions."""
    for node in ast.walk(ast.parse(path.read_text())):
        match node:
            case ast.ImportFrom(module=str(name)) if name.startswith("coheft."):
                yield from (f"{name}.{alias.name}".removeprefix("coheft.") for alias in node.names)
            case ast.Import():
                yield from (a.name.removeprefix("coheft.") for a in node.names if a.name.startswith("coheft."))


def test_imports_point_one_way() -> None:
    wrong = []
    for name, path in modules().items():
        room = max((room for room in ALLOWED if name.startswith(room)), key=len, default=None)
        if room is not None:
            wrong += [f"{name} imports {other}" for other in imported(path) if not other.startswith(ALLOWED[room])]
    assert wrong == []


@pytest.mark.parametrize(("part", "stranger"), STRANGERS)
def test_parts_do_not_know_of_each_other(part: str, stranger: str) -> None:
    inside = {name: path for name, path in modules().items() if name.startswith(f"{part}.")}
    assert inside, f"there is no {part}"
    wrong = [f"{name} imports {other}" for name, path in inside.items() for other in imported(path)]
    assert [text for text in wrong if f" {stranger}." in text] == []


def test_every_module_is_looked_at() -> None:
    assert {"agents.agent", "consensus.gossip", "physics_server.server", "app.cli.main"} <= set(modules())
