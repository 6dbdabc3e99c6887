"""Interface of everything that follows a run beside the report: a recorder, a view, curves over time."""

from coheft.app.run.news import News
from coheft.wire.messages.requests import Status


class Follower:
    """Base class of everything that follows a run. It is called in the supervisor's thread, so it must be quick."""

    def begin(self, status: Status) -> None:
        """Begin: all links are up and the clock runs; ``status`` holds the scene and the duration."""

    def receive(self, news: News) -> None:
        """Process a checked message of the server or an agent."""

    def end(self, status: Status) -> None:
        """End, when the run has ended; not called if it failed."""
