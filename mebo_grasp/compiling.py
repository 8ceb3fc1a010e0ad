"""Two ways to compile a function with numba: one that may make arrays, one that borrows those of its caller.

Where a function takes an array, or a tuple of arrays, numba counts a reference with an atomic instruction, and again
where it lets go. A function that runs a microsecond and takes twenty arrays does little else: without counting, a
search among occlusions takes half the time. What borrows must make no array, list or closure, and whoever calls it
holds the arrays meanwhile; a function that does make one is refused when it is compiled. Where what is called makes
arrays of its own all along the way, as the closing of a hand does, ``grasping.borrowed`` borrows single arguments.

Whether references are counted is said in both, as numba otherwise takes it over from whichever function is the first
to call.
"""

from __future__ import annotations

from numba import njit

compiled = njit(cache=True, nogil=True, _nrt=True)
borrowing = njit(cache=True, nogil=True, _nrt=False)
borrowing_inlined = njit(cache=True, nogil=True, _nrt=False, inline="always")
"""Put into its caller by numba itself, for what takes less time than to hand over its arguments."""
