"""The view of a run in a browser: ``model`` has the state to show, ``page`` shows it with viser.

Needs the packages of the extra ``view``; without them this import raises ``MissingPackageError``.
"""

from coheft.errors import require_packages

require_packages("view", "viser", "Jinja2")
