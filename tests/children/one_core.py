"""Sparse LU from compiled code in a process that has one core."""

import os

import jax
import numpy as np

from jaxnc.solvers.sparse_matrix import Factoriser

os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})  # before JAX counts them, which it does when it first computes
jax.config.update("jax_enable_x64", True)
count = 40_000  # 320 KB, more than JAX copies without help of another thread
lu = Factoriser(count, np.arange(count), np.arange(count))
print(float(jax.jit(lu.solve)(np.full(count, 2.0), np.ones((count, 1))).sum()))
