# SPDX-License-Identifier: Apache-2.0
"""Contains the modules that have these names in gsplat. They run on every device of ubs, not only with CUDA."""
