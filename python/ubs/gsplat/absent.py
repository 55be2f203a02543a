# SPDX-License-Identifier: Apache-2.0
"""Lists names of gsplat 1.5 and 1.6 that ubs.gsplat does not implement. Scripts can import them, because many
scripts import more names than they use. Calling one of them raises a UsageError that states what to use instead."""

from __future__ import annotations

from typing import Any, Callable, NoReturn

from .._errors import UsageError

_LOSSES = """create_ssim_window depth_l1_loss gaussian_density_reg gaussian_scale_reg gaussian_z_scale_reg l1_loss mse_loss
    opacity_reg_loss out_of_bound_loss scale_reg_loss ssim_loss torch_ssim_loss total_variation_loss FusedGaussianLosses"""
_LIDAR = """isect_tiles_lidar lidar_background_loss lidar_distance_loss lidar_intensity_loss lidar_raydrop_loss
    compute_lidar_angles_to_columns_map compute_lidar_tiling LidarTiling SpinningDirection
    RowOffsetStructuredSpinningLidarModelParameters RowOffsetStructuredSpinningLidarModelParametersExt"""
_LISTS = """isect_tiles_sparse build_sparse_tile_layout rasterize_to_pixels
    rasterize_to_pixels_sparse rasterize_to_indices_in_range accumulate rasterize_num_contributing_gaussians
    rasterize_num_contributing_gaussians_sparse rasterize_contributing_gaussian_ids
    rasterize_contributing_gaussian_ids_sparse rasterize_top_contributing_gaussian_ids
    rasterize_top_contributing_gaussian_ids_sparse"""
_SURFELS = """rasterization_2dgs rasterization_2dgs_inria_wrapper fully_fused_projection_2dgs rasterize_to_pixels_2dgs
    rasterize_to_indices_in_range_2dgs accumulate_2dgs"""
_RAYS = """fully_fused_projection_with_ut rasterize_to_pixels_eval3d ExternalDistortionModelMeta
    ExternalDistortionModelParameters FThetaCameraDistortionParameters FThetaPolynomialType
    UnscentedTransformParameters"""
_PROCESSES = "all_gather_int32 all_gather_tensor_list all_to_all_int32 all_to_all_tensor_list"

# Groups of names. The second text of each group states what to use instead of these names.
_GROUPS = (
    (_SURFELS, "2D Gaussian Splatting is not supported: use rasterization(), or gsplat on CUDA"),
    ("rasterization_inria_wrapper", "use rasterization(), which computes the same formulas"),
    (_LISTS, "use rasterization(), or ubs.torch.rasterize() for projected Gaussians"),
    (_RAYS, "lens distortion is not supported: undistort the images first, or use gsplat on CUDA"),
    (_LIDAR, "lidar is not supported: use gsplat on CUDA"),
    ("persp_proj", "use proj()"),
    ("spherical_harmonics_l0 spherical_harmonics_l1_plus", "use spherical_harmonics()"),
    ("adam", "use SelectiveAdam"),
    ("PngCompression", "use export_splats(..., format='ply_compressed'), or convert a PLY file with `ubs convert`"),
    (_PROCESSES, "ubs.gsplat runs in one process: remove the call"),
    (_LOSSES, "write the loss in PyTorch"),
    ("color_correct_affine color_correct_quadratic", "write the correction in PyTorch"),
    (
        "RendererConfig RendererConfig_MixedBatch RendererConfig_ParallelBatch",
        "remove the configuration, which only determines how gsplat divides its work",
    ),
)
INSTEAD = {name: instead for names, instead in _GROUPS for name in names.split()}


def refusing(module: str, name: str) -> Callable[..., NoReturn]:
    """Returns a function that raises UsageError when it is called. Raises AttributeError if `name` is not one of the
    listed names of gsplat."""
    if name not in INSTEAD:
        raise AttributeError(f"module {module!r} has no attribute {name!r}")

    def refuse(*_: Any, **__: Any) -> NoReturn:
        raise UsageError(f"{name} does not exist in ubs.gsplat: {INSTEAD[name]}")

    refuse.__name__ = refuse.__qualname__ = name
    return refuse
