"""Whether a rigid body explains a recording, and if not, which single cause would.

Functions raise ``ValueError`` if there are too few samples, or too few per second, to tell noise from motion.
"""
