"""Names of robots in sentences."""

from collections.abc import Mapping, Sequence

from coheft.errors import CoheftError


def few(names: Sequence[str], most: int = 8) -> str:
    """List names, the first ones only if there are many: large teams would fill the screen."""
    if len(names) <= most:
        return ", ".join(names)
    return f"{', '.join(names[: most - 1])} and {len(names) - most + 1} more"


def check_link(neighbours: Mapping[str, Sequence[str]], one: str, other: str) -> None:
    """Check that two robots of a graph are neighbours; a ``CoheftError`` names all links if they are not."""
    if other not in neighbours.get(one, ()):
        links = ", ".join(f"{a}-{b}" for a, others in neighbours.items() for b in others if a < b)
        raise CoheftError(f"there is no link {one}-{other}; the links are {links}")
