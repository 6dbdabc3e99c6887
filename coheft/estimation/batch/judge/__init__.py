"""Whether a rigid body explains a recording, and if not, which single cause would."""
