"""Other meanings of a cart's recording, with one of which all of it may fit."""

from collections.abc import Callable, Iterator
from dataclasses import replace

import numpy as np

from coheft.errors import RecordingError
from coheft.estimation.cart.model import axes
from coheft.wire.cart.recording import CartRecording

_MOST_SAMPLES, _LEAST_RATE = 200, 10.0
_KGF = 9.80665
_FEET, _CM = 0.3048, 0.01
Hand = tuple[float, float]


def explanation(recording: CartRecording, hand: Hand, is_known: Callable[[CartRecording, Hand], bool]) -> str:
    """Find a meaning with which the whole recording fits; empty if there is none.

    ``hand`` is the point at which pushes are said to be measured [m]; ``is_known`` tells whether a recording fits, and
    shows everything.
    """
    thin = _thinned(recording)
    for words, other, point in _meanings(thin, hand):
        try:
            if is_known(other, point):
                return f"everything would fit if {words}"
        except RecordingError:
            continue
    return ""


def _meanings(recording: CartRecording, hand: Hand) -> Iterator[tuple[str, CartRecording, Hand]]:
    pushes, poses = recording.pushes, recording.poses
    x, y = hand
    in_cart = np.array([axes(pose[2]).T @ push for pose, push in zip(poses, pushes, strict=True)])
    scaled = {
        "mz had the opposite sign": [1.0, 1.0, -1.0],
        "mz were in N·mm": [1.0, 1.0, 1e-3],
        "fx and fy were in kgf, and mz in N·m": [_KGF, _KGF, 1.0],
        "fx, fy and mz were in kgf and kgf·m": [_KGF, _KGF, _KGF],
    }
    yield "fx and fy were exchanged", replace(recording, pushes=pushes[:, [1, 0, 2]]), hand
    yield "pushes were in the floor's axes", replace(recording, pushes=in_cart), hand
    for words, factors in scaled.items():
        yield words, replace(recording, pushes=pushes * factors), hand
    exchanged = replace(recording, poses=poses[:, [1, 0, 2]], rates=recording.rates[:, [1, 0, 2]])
    yield "x and y, and vx and vy, were exchanged", exchanged, hand
    if x or y:
        yield "torques were about the middle of the axle (--hand 0 0)", recording, (0.0, 0.0)
    if y:
        yield f"the hand were on the other side (--hand {x:g} {-y:g})", recording, (x, -y)
    for words, length in (("feet", _FEET), ("centimetres", _CM)):
        lengths = np.array([length, length, 1.0])
        moved = replace(recording, poses=poses * lengths, rates=recording.rates * lengths)
        yield f"lengths were in {words}", moved, hand
    for samples in (1, 3, -1, -3):
        late = recording.times[abs(samples)] - recording.times[0]
        words, inner = f"pushes were {1e3 * late:.0f} ms too {'late' if samples > 0 else 'early'}", slice(4, -4)
        shifted = np.roll(pushes, -samples, axis=0)[inner]
        yield words, CartRecording(recording.times[inner], poses[inner], recording.rates[inner], shifted), hand


def _thinned(recording: CartRecording) -> CartRecording:
    """Fewer samples if there are many, with the mean push between them; plans are left out."""
    count = len(recording.times)
    rate = (count - 1) / float(recording.times[-1] - recording.times[0])
    every = max(1, min(-(-count // _MOST_SAMPLES), int(rate / _LEAST_RATE)))
    kept = count // every * every
    return CartRecording(
        recording.times[:kept:every],
        recording.poses[:kept:every],
        recording.rates[:kept:every],
        recording.pushes[:kept].reshape(-1, every, 3).mean(axis=1),
    )
