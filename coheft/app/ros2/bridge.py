"""The bridge from a run to ROS 2: an observer that publishes its received messages as standard ROS messages."""

from collections.abc import Callable, Iterable

from coheft.app.recording import ros
from coheft.app.recording.log_book import LogBook
from coheft.app.recording.ros import RosMessage
from coheft.app.recording.topics import estimate_messages, scene_messages, truth_messages
from coheft.app.ros2.names import check_ros_names
from coheft.app.ros2.node import RosNode, open_node
from coheft.app.run.folder import RunFile
from coheft.app.run.news import News
from coheft.app.run.observer import observe
from coheft.wire.messages.requests import RunState, StatusRequest
from coheft.wire.messages.structs import Estimate
from coheft.wire.messages.truth import Scene, Truth

NODES = ("coheft", "coheft_driver")
"""Names of bridges and drivers, which publish on the same topics."""
_SILENCE = 2.0
_LATCHED = "/tf_static"
_GROUPS = {"estimate", "measured"}
"""Parts of a recording's topics that are omitted in ROS topics: ``/r3/payload`` for ``/r3/estimate/payload``."""


class Bridge:
    """Publishes an observer's messages on a node.

    Stamps are the ends of blocks: of the run's own time or, given the ROS time of the start of block 0 as ``epoch``
    [ns], of the robots'.
    """

    def __init__(self, node: RosNode, epoch: int = 0) -> None:
        self._node = node
        self._log = LogBook()
        self._epoch = self._newest = epoch

    def show_scene(self, scene: Scene) -> None:
        """Publish the constant part of the scene, which the truth needs."""
        self._scene = scene
        self._publish(scene_messages(self._epoch, scene))

    def receive(self, news: News) -> None:
        """Publish a message and the lines of the log that follow from it."""
        if isinstance(news, Truth):
            time = self._note_time(news.time)
            self._node.publish("/clock", ros.clock(time))
            self._publish(truth_messages(time, news, self._scene))
        elif isinstance(news, Estimate):
            time = self._note_time(news.time)
            total_time = self._note_time(news.time * (news.total_block + 1) / (news.block + 1))
            self._publish(estimate_messages(time, news, total_time))
        for line in self._log.lines(news):
            self._node.publish("/rosout", ros.log(self._newest, *line))

    def _note_time(self, seconds: float) -> int:
        """Convert a simulated time [s] to a stamp [ns]."""
        time = self._epoch + round(seconds * 1e9)
        self._newest = max(self._newest, time)
        return time

    def _publish(self, messages: Iterable[tuple[str, RosMessage]]) -> None:
        for topic, message in messages:
            name = "/".join(part for part in topic.split("/") if part not in _GROUPS)
            self._node.publish(name, message, latched=topic == _LATCHED)


def bridge_run(run_file: RunFile, endpoint: str, domain: int, tell: Callable[[str], None], namespace: str) -> None:
    """Publish the messages of a run in ROS 2, until the run has ended.

    ``endpoint`` is that of the router of ROS 2; ``tell`` is called with lines for the user.

    Raises:
        LinkError: There is no router there, or another bridge or a driver uses it with these topics, or the run's
            server does not answer, or not any more.
        CoheftError: ROS does not take a robot's name, or the run is secure and there are no keys of an observer.
    """
    with observe(run_file) as observer, open_node(NODES[0], endpoint, domain, namespace) as node:
        node.check_alone(NODES)
        status = observer.ask(StatusRequest())
        scene = status.scene
        check_ros_names(scene.robots)
        bridge = Bridge(node)
        bridge.show_scene(scene)
        tell(f"node {node.name} in ROS domain {domain}, by the router at {endpoint}; Ctrl-C ends it, the run goes on")
        had_router = True
        while status.state is not RunState.FINISHED:
            news = observer.collect(scene, _SILENCE)
            for item in news:
                bridge.receive(item)
            if not news:
                status = observer.status() or status
                observer.check_server()
            if node.has_router != had_router:
                had_router = not had_router
                tell("the router is back" if had_router else f"the router at {endpoint} is gone; waiting for it")
        tell(f"the run has ended; {node.published} messages were received on {len(node.topics)} topics")
