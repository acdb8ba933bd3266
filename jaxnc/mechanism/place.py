"""What a user gives for a place."""

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np

Place: TypeAlias = Sequence[float] | np.ndarray
"""A position or direction given by the user, `dim` numbers."""
