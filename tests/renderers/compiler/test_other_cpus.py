"""Golden images are bit-identical on a CPU without AVX."""

import os
import platform
import subprocess
import sys
from pathlib import Path
from typing import Final

import llvmlite.binding as llvm
import pytest

_ROOT: Final = Path(__file__).parents[3]
_OLD: Final = {
    *("64bit", "cmov", "cx8", "cx16", "fxsr", "mmx", "sahf", "popcnt", "crc32"),
    *("sse", "sse2", "sse3", "ssse3", "sse4.1", "sse4.2"),
}
"""Features of x86-64-v2: all our AVX2 and AVX-512 intrinsics fall back to plain LLVM."""
_CHILD: Final = """
import sys
import pytest
from numba import float32, njit

@njit(float32(float32[::1]))
def total(values):
    return (values * values + values).max()

(assembly,) = total.inspect_asm().values()
assert "xmm" in assembly and not any(register in assembly for register in ("ymm", "zmm")), assembly
sys.exit(pytest.main(["-q", "-p", "no:cacheprovider", *sys.argv[1:]]))
"""


@pytest.mark.slow
@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="names processors of x86-64")
def test_golden_images_without_avx() -> None:
    """Kernels of this processor may lie in the same folder: Numba keeps them apart."""
    features = ",".join(f"{'+' if name in _OLD else '-'}{name}" for name in llvm.get_host_cpu_features())
    environment = {**os.environ, "NUMBA_CPU_NAME": "nehalem", "NUMBA_CPU_FEATURES": features}
    environment.pop("SCENEGATE_REGENERATE_PICTURES", None)
    files = ("test_pictures.py", "shading/test_images.py")
    ended = subprocess.run(
        (sys.executable, "-c", _CHILD, *(f"tests/renderers/{file}" for file in files)),
        cwd=_ROOT,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert ended.returncode == 0, ended.stdout + ended.stderr
