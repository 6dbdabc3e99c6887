"""The view of a run in a browser: ``model`` knows what there is to show, ``page`` shows it with viser."""
