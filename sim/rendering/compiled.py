"""Compilation of the renderer's loops by numba.

LLVM does not vectorise a loop that gathers from one array and stores to another, because
the two might overlap. The arrays that the row loops get never do; `row_loop` says so.
"""

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt
from llvmlite import binding, ir
from numba import get_num_threads, njit, types
from numba.core.compiler import CompilerBase, DefaultPassBuilder, Flags
from numba.extending import intrinsic

Floats = npt.NDArray[np.float32]
Ints = npt.NDArray[np.int32]
Words = npt.NDArray[np.uint32]
Doubles = npt.NDArray[np.float64]

f32 = np.float32
i32 = np.int32
u32 = np.uint32
u64 = np.uint64


class _NoAlias(CompilerBase):
    """Numba compiler that assumes array arguments not to overlap."""

    def define_pipelines(self) -> list[Any]:
        self.state.flags.noalias = True
        return [DefaultPassBuilder.define_nopython_pipeline(self.state)]


# Nothing calls these loops from C. Operations are made as they are written: where LLVM may reorder or fuse them, the copy of
# an inner loop that was compiled alone rounds otherwise than the copy within its caller, and a process that compiles calls the
# one, a process that loads stored loops the other. It gains no time either.
_FAST: dict[str, Any] = {
    "cache": True,
    "fastmath": {"nnan", "ninf", "nsz"},
    "error_model": "numpy",
    "no_cfunc_wrapper": True,
}

inlined = njit(**_FAST, inline="always")
by_share = njit(**_FAST, nogil=True)
"""For loops over rows of which each thread takes every n-th block: `kernel(worker, n_workers, ...)`."""

# Compiled functions call the following; Python cannot. The wrapper for Python, which unpacks tuples of dozens of arrays,
# takes as long to compile as many a function.
_INNER = _FAST | {"no_cpython_wrapper": True}
scalar = njit(**_INNER)
# Without the flag, which is internal to numba, frames take 2.6 times as long and look the same.
row_loop = njit(**_INNER, pipeline_class=_NoAlias) if "noalias" in dir(Flags) else scalar


def _fused(typing_context: Any, a: Any, b: Any, c: Any) -> Any:
    """Return a b + c of single precision, rounded once where the processor can."""
    del typing_context, a, b, c

    def build(_: Any, builder: Any, __: Any, arguments: Any) -> Any:
        single = ir.FloatType()
        kind = ir.FunctionType(single, [single] * 3)
        return builder.call(builder.module.declare_intrinsic("llvm.fmuladd.f32", (), kind), arguments)

    return types.float32(types.float32, types.float32, types.float32), build


fused: Callable[..., Any] = intrinsic(_fused)


def share_out(kernel: Callable[..., None], *arguments: Any) -> None:
    """Run a `by_share` loop on as many threads as numba may use; what they write does not overlap."""
    n_workers = get_num_threads()
    if n_workers == 1:
        kernel(0, 1, *arguments)
        return
    helpers = _helpers(n_workers - 1)
    shares = [helpers.submit(kernel, worker, n_workers, *arguments) for worker in range(1, n_workers)]
    kernel(0, n_workers, *arguments)
    for share in shares:
        share.result()


@lru_cache(maxsize=1)
def _helpers(n: int) -> ThreadPoolExecutor:
    """Return a thread pool that lasts from frame to frame, because starting threads is slow."""
    return ThreadPoolExecutor(n, "renders")


_CPU = binding.get_host_cpu_features()
_PREFERS_GATHERS = f'"target-features"="{_CPU.flatten()},+fast-gather"'


def _for_gathers(typing_context: Any, index: Any) -> Any:
    """Return an index as it is, and have LLVM use the gather instruction of AVX2 in the function around it.

    On processors of AMD LLVM expects it to be slow and leaves the loops scalar; with it frames take three quarters of the time.
    """
    del typing_context, index

    def build(_: Any, builder: Any, __: Any, arguments: Any) -> Any:
        if _CPU.get("avx2") and not _CPU.get("avx512f"):
            # The method `add` of llvmlite's class refuses attributes with values.
            set.add(builder.function.attributes, _PREFERS_GATHERS)
        return arguments[0]

    return types.uint32(types.uint32), build


_gathered: Callable[..., Any] = intrinsic(_for_gathers)


@inlined
def entry(index: int) -> np.uint32:
    """Return an index that is not negative in the form that gathers take 16 at a time."""
    return _gathered(u32(u32(index) & u32(0x7FFFFFFF)))


@inlined
def hash32(i: int, j: int) -> np.uint32:
    """Mix two numbers into 32 bits."""
    h = u32(u32(i) * u32(374761393)) + u32(u32(j) * u32(668265263))
    h = u32(u32(h ^ (h >> u32(13))) * u32(1274126177))
    return u32(h ^ (h >> u32(16)))
