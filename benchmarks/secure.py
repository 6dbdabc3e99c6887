"""The secure profile against the open one: encrypted links, access rules, signed words of robots about themselves.

Two teams take turns of a second or two, while the other stands still.
"""

import tempfile
from pathlib import Path

from benchmarks.figures import Effort, Figure, Section, against
from benchmarks.paced_team import SIZES, TURN, Turn, compared, paced_team
from benchmarks.scenarios import SETTLED, team_scenario
from coheft.app.run.keys import make_keys

BAR = 1.15
_TURNS: dict[Effort, int] = {"short": 6, "usual": 10, "full": 30}


def measure(effort: Effort) -> Section:
    """Compare the profiles for each size of team."""
    figures = [figure for robots in SIZES for figure in _of_size(robots, _TURNS[effort])]
    return Section(name="secure", title="Secure profile against the open one", figures=figures)


def _of_size(robots: int, turns: int) -> list[Figure]:
    scenario = team_scenario(robots)
    secure: list[Turn] = []
    plain: list[Turn] = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        make_keys(folder / "keys", scenario)
        with paced_team(scenario, folder / "secure", keys=folder / "keys") as locked:
            locked.run_until(SETTLED)  # first, so that the other team finds other ports free
            with paced_team(scenario, folder / "open") as free:
                free.run_until(SETTLED)
                for _ in range(turns):
                    secure.append(locked.turn(TURN[robots]))
                    plain.append(free.turn(TURN[robots]))

    return [
        against(f"{title}, N = {robots}", *compared(quantity, secure, plain), bar=bar)
        for title, quantity, bar in (
            ("time per block", "block_time", BAR),
            ("CPU time per agent and block", "agent_time", None),
            ("CPU time of the server per block", "server_time", None),
        )
    ]
