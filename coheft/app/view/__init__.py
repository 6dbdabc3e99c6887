"""The view of a run in a browser: ``model`` has the state to show, ``page`` shows it with viser.

Needs the packages of the extra ``view``; without them this import raises ``MissingPackageError``.
"""

from importlib.util import find_spec

from coheft.errors import MissingPackageError

for _package, _module in (("viser", "viser"), ("Jinja2", "jinja2")):
    if find_spec(_module) is None:
        raise MissingPackageError(_package, "view")
