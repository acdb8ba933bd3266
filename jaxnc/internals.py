"""Every place where JAX's internals are used, because no public name does the same.

Each is read when it is needed, so that a version of JAX without it costs speed or a message, and never a wrong number.
Present in JAX 0.8 to 0.12.
"""

import importlib
import sys
from pathlib import Path
from typing import Any

import jax
from jax import core

# The public jax.extend.core.get_opaque_trace_state brings Pallas with it, which takes as long as all of a first answer.
outermost = getattr(importlib.import_module("jax._src.core"), "trace_state_clean", lambda: False)
"""Tell whether nothing is being traced: options may be given for a whole compilation only."""


def evaluate_at_once() -> Any:
    """Make a context in which numbers that are known are calculated, as if nothing were traced around them."""
    # The public way to the same folds every operation on constants within what is compiled there, one by one.
    return getattr(core, "eval_context", jax.ensure_compile_time_eval)()


def values_behind(tree: Any) -> Any:
    """Return the numbers behind arrays that are differentiated once; None if some are not known.

    Mapped arrays and what is being compiled have none. Derivatives of a second order are made by two traces: those of
    one array, or one trace's of one array and the other's of another.
    """
    leaves, structure = jax.tree.flatten(tree)
    traced = [x for x in leaves if isinstance(x, core.Tracer)]
    found = [getattr(x, "primal", None) if isinstance(x, core.Tracer) else x for x in leaves]
    if any(x is None or isinstance(x, core.Tracer) for x in found):
        return None
    traces = [getattr(x, "_trace", None) for x in traced]
    if any(trace is None or trace is not traces[0] for trace in traces):
        return None
    return jax.tree.unflatten(structure, found)


def name_of_jax(jaxpr: Any) -> str | None:
    """Return the name of the function that a jaxpr was made of, if it is one of JAX's own."""
    told = getattr(jaxpr, "debug_info", None)
    own = Path(jax.__file__).parent in Path(getattr(told, "func_filename", None) or "").parents
    return getattr(told, "func_name", None) if own else None


def has_started() -> bool:
    """Tell whether JAX has started its threads, which a forked process has not got."""
    bridge = sys.modules.get("jax._src.xla_bridge")
    return bool(bridge and getattr(bridge, "backends_are_initialized", lambda: True)())
