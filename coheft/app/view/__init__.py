"""The view of a run in a browser: ``model`` knows what there is to show, ``page`` shows it with viser.

Takes the packages of the extra ``view``; without them this import raises ``MissingPackageError``.
"""

from importlib.util import find_spec

from coheft.errors import MissingPackageError

if find_spec("viser") is None:
    raise MissingPackageError("viser", "view")
