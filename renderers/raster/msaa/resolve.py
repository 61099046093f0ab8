"""Anti-aliasing of the headlight looks: the memory of sample bands, and two ways to resolve samples to colours."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.compiler.kernel_calls import kernel_address
from renderers.compiler.pointers import address_of, aligned
from renderers.compiler.simd import LANES
from renderers.drawlist import DrawList
from renderers.interface import Look
from renderers.msaa import SampleBand, sample_cameras
from renderers.raster.msaa.edges import shade_mixed
from renderers.shading import HeadlightJob, ShadingScene, paint
from renderers.shading.headlight.shade_rows import shade_rows
from renderers.visibility_buffer import BAND_ROWS, Rasterizer, SampledShader

_GAP: Final = 64
"""Values between arrays of a band: vectors are read past an array's end."""


def allocate_sample_bands(threads: int, camera: Camera, samples: int, stride: int) -> tuple[int, object]:
    """Return the address of a SampleBand for each thread, and their memory; ``stride``: of a row of ids."""
    max_entries = (samples - 1) * camera.width  # of a row: all surfaces of its pixels but one each, see SampleBand
    word_counts = {  # words of 4 bytes
        "sample_ids": BAND_ROWS * stride * LANES,
        "sample_inv_z": BAND_ROWS * stride * LANES,
        "ids": BAND_ROWS * stride,
        "far": BAND_ROWS * stride,
        "near": BAND_ROWS * stride,
        "slots": BAND_ROWS * stride,
        "owners": BAND_ROWS * stride,
        "counts": BAND_ROWS,
        "entry_ids": BAND_ROWS * max_entries,
        "entry_columns": BAND_ROWS * max_entries,
        "entry_weights": BAND_ROWS * max_entries // 4,
        "mixed_counts": BAND_ROWS,
        "mixed": BAND_ROWS * stride,
        "entry_colors": BAND_ROWS * max_entries * 3 // 4,
    }
    nbytes = 4 * (sum(word_counts.values()) + _GAP * len(word_counts))
    memory, array_address = aligned((threads * nbytes,), np.uint8)
    bands, address = aligned((threads,), SampleBand.dtype)
    bands["max_entries"] = max_entries
    for field, count in word_counts.items():
        bands[field] = array_address + nbytes * np.arange(threads)
        array_address += 4 * (count + _GAP)
    return address, (memory, bands)


def mixing_shader(job: HeadlightJob) -> SampledShader:
    """Return a shader of an opaque scene that mixes colours as bytes, as VTK does; ``job``: of the whole image."""
    mixing_job = np.array((kernel_address(shade_rows), job.address), np.int64)
    return SampledShader(kernel_address(shade_mixed), address_of(mixing_job, np.int64), (mixing_job, job))


def paint_each_sample(
    rasterizer: Rasterizer, scene: DrawList, shading: ShadingScene, camera: Camera, look: Look, color: NDArray[np.uint8]
) -> None:
    """Paint a translucent scene once per sample position and average the colours as bytes."""
    total = np.zeros(color.shape, np.uint16)
    for sample_camera in sample_cameras(camera, look.samples):
        paint(rasterizer, scene, shading, sample_camera, look, color)
        total += color
    color[:] = (total + look.samples // 2) // look.samples
