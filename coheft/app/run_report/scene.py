"""The scene of a report: the payload, the robots and the motion, as JSON for the script of the page."""

from typing import Any

import msgspec

from coheft.app.run_report.series import Series
from coheft.estimation.geometry.spatial import Array
from coheft.wire.messages.truth import Truth
from coheft.wire.scenario.section import pose_of

_DIGITS = 4


def scene_json(series: Series) -> str:
    """Return JSON for a page. Lengths are in metres, times in seconds, quaternions have the scalar first."""
    scene = series.scene
    links = [[a, b] for a in scene.robots for b in scene.neighbours.get(a, []) if a < b]
    moments = list(series.moments)
    found: dict[str, Any] = {
        "robots": [
            {"name": name, "rotation": _rounded(rotation), "position": _rounded(position)}
            for name, rotation, position in zip(scene.robots, scene.rotations, scene.translations, strict=True)
        ],
        "links": links,
        "boxes": [
            {
                "size": box.size,
                "position": box.position,
                "rotation": _rounded(pose_of(box.position, box.rotation_deg).rotation),
            }
            for box in scene.boxes
        ],
        "times": [round(moment.time, _DIGITS) for moment in moments],
        "positions": [_rounded(moment.position) for moment in moments],
        "quaternions": [_rounded(moment.quaternion) for moment in moments],
        "loads": _loads(moments),
        "states": {
            name: [[round(span.start, 3), str(span.state)] for span in robot.states.spans]
            for name, robot in series.robots.items()
        },
    }
    return msgspec.json.encode(found).decode().replace("<", "\\u003c")  # no name ends the script


def _loads(moments: list[Truth]) -> list[tuple[float, Any]]:
    """Return the loads on the payload and the times at which they changed; one that leaks stays the same load."""
    changes: list[tuple[float, Any]] = []
    before: list[int] = []
    for moment in moments:
        if (now := [load.id for load in moment.loads]) != before or not changes:
            shown = [{"size": load.size, "position": load.position, "mass": load.mass} for load in moment.loads]
            changes.append((round(moment.time, _DIGITS), shown))
        before = now
    return changes


def _rounded(values: Array) -> Any:
    return values.round(_DIGITS).tolist()
