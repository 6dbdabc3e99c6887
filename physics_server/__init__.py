"""The physics server: the payload, the robots' low-level impedance, sensors and loads.

It knows nothing of agents; what it sends them and hears from them is defined in ``coheft.wire``.
"""

from __future__ import annotations
