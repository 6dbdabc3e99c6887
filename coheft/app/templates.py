"""Templates of HTML, which escape texts from other processes; they need Jinja2, an optional package."""

from pathlib import Path

from jinja2 import Environment, FileSystemLoader, StrictUndefined

from coheft.app.terminal.digits import significant


def templates_beside(module: str) -> Environment:
    """Return the templates in the folder of a module, given by its ``__file__``."""
    templates = Environment(
        loader=FileSystemLoader(Path(module).parent),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    templates.filters["significant"] = significant
    return templates
