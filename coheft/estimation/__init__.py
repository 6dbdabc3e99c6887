"""Estimation: pure functions and filters on arrays. No sockets, no clock, no threads.

Papers that are cited by authors only:

- Fan et al.: "Decentralized and Recursive Identification for Cooperative Manipulation of Unknown Rigid Body with Local
  Measurements", CDC 2017.
- Zhang et al.: Zhang, Liu, Elwin, Freeman, Lynch, "Cooperative Payload Estimation by a Team of Mocobots", RA-L 2025.
- Aguilera et al.: Aguilera, Murtaza, Rogers, Hutchinson, "Modeling and Inertial Parameter Estimation of Cart-like
  Nonholonomic Systems Using a Mobile Manipulator".
"""
