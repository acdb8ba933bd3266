"""jaxnc: mechanisms that can be designed by gradient, in natural coordinates on JAX."""
from jaxnc.mechanism import Mechanism
from jaxnc.kinematics.position import solve_position, sweep, motion
