"""Arrays that compiled code uses without counting references to them.

Numba counts a reference with an atomic instruction wherever a function takes an array, or a tuple of arrays, from
another. Closing a hand hands the same arrays from function to function tens of thousands of times, and counting took a
quarter of its time.
"""

from __future__ import annotations

from typing import Any

from numba.core import cgutils
from numba.extending import intrinsic


@intrinsic
def borrowed(_typing_context: Any, array: Any) -> tuple[Any, Any]:
    """Return an array of the same data that owns nothing, to be used only while the owner is in reach."""

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        view = context.make_array(signature.return_type)(context, builder, value=arguments[0])
        view.meminfo = cgutils.get_null_value(view.meminfo.type)
        view.parent = cgutils.get_null_value(view.parent.type)
        return view._getvalue()

    return array(array), generate
