"""The physics server: the payload, the robots' arms with impedance control, sensors and loads.

It does not depend on the agents; ``coheft.wire`` defines the messages that it exchanges with them.
"""
