# SPDX-License-Identifier: Apache-2.0
"""Lists of the tiles that Gaussians touch, as gsplat 1.5 makes them. ubs renders with lists of its own, which stay on
the device and leave out tiles that an ellipse does not reach. The lists of this module are for scripts that read them.
"""

from __future__ import annotations

import functools
import math
from typing import Any, Optional

import torch
from torch import Tensor

from .._errors import NumericalError, UsageError
from .._raster import is_finite
from .checks import shape_of, whole_number
from .meta import Meta


def _tile_bits(tile_width: int, tile_height: int) -> int:
    """Returns the number of bits of isect_ids that contain the index of a tile. It is that of gsplat 1.5."""
    return (tile_width * tile_height).bit_length()


def _count_of_images(value: Any) -> int:
    return 0 if value == 0 else whole_number("n_images", value, 2**31)


def isect_tiles(
    means2d: Tensor,
    radii: Tensor,
    depths: Tensor,
    tile_size: int,
    tile_width: int,
    tile_height: int,
    sort: bool = True,
    segmented: bool = False,
    packed: bool = False,
    n_images: Optional[int] = None,
    image_ids: Optional[Tensor] = None,
    gaussian_ids: Optional[Tensor] = None,
) -> tuple[Tensor, Tensor, Tensor]:
    """Lists the pairs of a tile and a Gaussian whose bounding box touches it. An image has tile_height rows of
    tile_width tiles, which have tile_size x tile_size pixels.

    means2d (..., N, 2) and radii (..., N, 2) are the centres and the half sides of the boxes in pixels; depths are
    (..., N). Boxes with a side of 0 touch no tile. With `packed`, the shapes are (nnz, 2) and (nnz,), image_ids (nnz,)
    are the images of the Gaussians, and n_images is the number of images. `segmented` and gaussian_ids have no effect.

    Returns the number of tiles of each Gaussian (..., N) or (nnz,), int32; the ids of the pairs, int64; and the indices
    of the Gaussians of the pairs, int32, in the flattened tensors. An id contains the index of the image, that of the
    tile, and in its lower 32 bits those of the depth as float32. With `sort`, the pairs are in the order of their ids,
    which is the order of depths within a tile."""
    shape = shape_of("means2d", means2d, 2)[:-1]
    if packed and len(shape) != 1:
        raise UsageError(f"with packed=True, means2d must have the shape (nnz, 2), not {tuple(means2d.shape)}")
    expected = {"means2d": (means2d, (*shape, 2)), "radii": (radii, (*shape, 2)), "depths": (depths, shape)}
    if packed:
        if image_ids is None or n_images is None:
            raise UsageError("packed=True needs image_ids and n_images")
        expected["image_ids"] = (image_ids, shape)
    for name, (tensor, wanted) in expected.items():
        if shape_of(name, tensor, 1) != wanted:
            raise UsageError(f"{name} has the shape {tuple(tensor.shape)}, not {wanted}")
        if tensor.device != means2d.device:
            raise UsageError(f"{name} is on {tensor.device}, but means2d is on {means2d.device}: move it there")
        if tensor.is_floating_point() and not is_finite(tensor):
            raise NumericalError(f"{name} contains values that are not finite")
    size = whole_number("tile_size", tile_size)
    across, down = whole_number("tile_width", tile_width), whole_number("tile_height", tile_height)
    images = math.prod(shape[:-1])
    if packed and image_ids is not None:
        images = _count_of_images(n_images)
        low, high = (int(image_ids.min()), int(image_ids.max())) if len(image_ids) > 0 else (0, -1)
        if image_ids.is_floating_point() or low < 0 or high >= images:
            raise UsageError(f"image_ids must be whole numbers from 0 to {images - 1} (n_images - 1)")
    bits = _tile_bits(across, down)
    if images.bit_length() + bits > 31:
        raise UsageError(f"{images} images of {across} x {down} tiles are too many: reduce their number or their size")

    centres, half = means2d.detach().reshape(-1, 2) / size, radii.reshape(-1, 2) / size
    last = torch.tensor([across, down]).to(centres)
    sides = torch.floor(centres - half), torch.ceil(centres + half)
    first, end = (torch.minimum(side, last).clamp_min(0) for side in sides)
    seen = (half > 0).all(-1, keepdim=True)
    spans = torch.where(seen, end - first, torch.zeros_like(first)).long()
    counts = spans.prod(-1)
    which = torch.arange(len(counts), device=counts.device).repeat_interleave(counts)
    place = torch.arange(len(which), device=counts.device) - (counts.cumsum(0) - counts)[which]  # within the box
    column = first[which, 0].long() + place % spans[which, 0]
    row = first[which, 1].long() + torch.div(place, spans[which, 0], rounding_mode="floor")
    if packed and image_ids is not None:
        image = image_ids.long()[which]
    else:
        image = torch.div(which, max(shape[-1], 1), rounding_mode="floor")
    depth = depths.detach().reshape(-1).float().contiguous().view(torch.int32).long()[which] & 0xFFFFFFFF
    ids = ((image << bits | row * across + column) << 32) | depth
    if sort:
        ids, order = ids.sort(stable=True)
        which = which[order]
    return counts.int().reshape(shape), ids, which.int()


def isect_offset_encode(isect_ids: Tensor, n_images: int, tile_width: int, tile_height: int) -> Tensor:
    """Returns, for each tile, the number of pairs of isect_tiles() that come before those of the tile
    (n_images, tile_height, tile_width), int32. isect_ids are the sorted ids that isect_tiles() returned for this number
    of images and tiles."""
    across, down = whole_number("tile_width", tile_width), whole_number("tile_height", tile_height)
    images = _count_of_images(n_images)
    if len(shape_of("isect_ids", isect_ids, 1)) != 1 or isect_ids.dtype != torch.int64:
        raise UsageError(f"isect_ids must be a tensor (n,) of int64, not {tuple(isect_ids.shape)} of {isect_ids.dtype}")
    bits, tiles = _tile_bits(across, down), across * down
    of_pair = isect_ids >> 32
    image, tile = of_pair >> bits, of_pair & ((1 << bits) - 1)
    if len(isect_ids) > 0:
        if bool((isect_ids[1:] < isect_ids[:-1]).any()):
            raise UsageError("isect_ids are not sorted: call isect_tiles() with sort=True")
        if int(isect_ids[0]) < 0 or int(image[-1]) >= images or int(tile.max()) >= tiles:
            raise UsageError(f"isect_ids do not belong to {images} images of {across} x {down} tiles")
    each = torch.arange(images * tiles, device=isect_ids.device)
    return torch.searchsorted(image * tiles + tile, each).int().reshape(images, down, across)


def add_lists(meta: Meta, batch: tuple[int, ...]) -> None:
    """Adds the lists to the dictionary of rasterization(), which has the batch dimensions `batch`. They are computed
    when they are read."""
    means2d, depths, radii = meta["means2d"].detach(), meta["depths"].detach(), meta.reader("radii")
    size, across, down, cameras = (meta[name] for name in ("tile_size", "tile_width", "tile_height", "n_cameras"))
    batch_ids, camera_ids, count = meta["batch_ids"], meta["camera_ids"], meta["n_batches"] * cameras

    @functools.cache
    def lists() -> dict[str, Tensor]:
        images = None if camera_ids is None else batch_ids * cameras + camera_ids
        given = (means2d, radii(), depths, size, across, down)
        found = isect_tiles(*given, packed=images is not None, n_images=count, image_ids=images)
        offsets = isect_offset_encode(found[1], count, across, down).reshape(*batch, cameras, down, across)
        return dict(zip(("tiles_per_gauss", "isect_ids", "flatten_ids", "isect_offsets"), (*found, offsets)))

    def list_of(name: str) -> None:
        meta.compute_later(name, lambda: lists()[name], means2d, depths)

    for name in ("tiles_per_gauss", "isect_ids", "flatten_ids", "isect_offsets"):
        list_of(name)
