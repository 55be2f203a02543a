# SPDX-License-Identifier: Apache-2.0
"""Computes covariances and colours of Gaussians as the formats of other programs define them. Tests that read such
files use these functions."""

import numpy as np

C0 = 0.28209479177387814  # the value of the constant spherical harmonic


def covariances(scale, wxyz):
    """Returns R diag(scale)^2 R^T; scale is (n, 3), wxyz (n, 4) quaternions of any length."""
    w, x, y, z = (wxyz / np.linalg.norm(wxyz, axis=1, keepdims=True)).T.astype(float)
    r = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    ).transpose(2, 0, 1)
    m = r * scale[:, None, :]
    return m @ m.transpose(0, 2, 1)


def colour(sh, d):
    """Returns colours (n, 3) from spherical harmonics up to degree 3 with the signs of 3DGS. sh is (n, coefficients,
    3), and d are unit vectors (n, 3)."""
    x, y, z = d.T
    xx, yy, zz = x * x, y * y, z * z
    basis = [
        C0 + 0 * x,
        -0.4886025119029199 * y,
        0.4886025119029199 * z,
        -0.4886025119029199 * x,
        1.092548430592079 * x * y,
        -1.092548430592079 * y * z,
        0.3153915652525200 * (2 * zz - xx - yy),
        -1.092548430592079 * x * z,
        0.5462742152960396 * (xx - yy),
        -0.5900435899266435 * y * (3 * xx - yy),
        2.890611442640554 * x * y * z,
        -0.4570457994644657 * y * (4 * zz - xx - yy),
        0.3731763325901154 * z * (2 * zz - 3 * xx - 3 * yy),
        -0.4570457994644657 * x * (4 * zz - xx - yy),
        1.445305721320277 * z * (xx - yy),
        -0.5900435899266435 * x * (xx - 3 * yy),
    ]
    return 0.5 + np.einsum("kn,nkc->nc", np.array(basis)[: sh.shape[1]], sh)
