"""The damping of an end stop from the part of the speed that it is to leave."""

import math


def loss(restitution: float) -> float:
    """``damping speed / stiffness`` of a stop that leaves a part of the speed.

    From ``m v dv = -(k + c v) x dx``, the same at touching and at leaving: a = c v / k solves
    ``a - ln(1 + a) = -e a - ln(1 - e a)``, where the mass does not appear.
    """
    if restitution == 1.0:
        return 0.0

    def left(a: float) -> float:
        return a - math.log1p(a) + restitution * a + math.log1p(-restitution * a)

    low, high = 0.5 * (1.0 - restitution), 1.0 / restitution
    for _ in range(200):
        middle = 0.5 * (low + high)
        if restitution * middle < 1.0 and left(middle) > 0.0:
            low = middle
        else:
            high = middle
    return low
