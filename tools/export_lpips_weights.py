#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Writes the weights of LPIPS 0.1 as safetensors files that `ubs` reads with --lpips-weights.

Needs the Python packages lpips, torch and torchvision (which download the weights on first use):

    pip install lpips torchvision
    tools/export_lpips_weights.py alex squeeze vgg --out lpips_weights

This writes lpips_weights/lpips_alex.safetensors and so on. Tensors are float32 with torchvision's names
(features.0.weight, ...) and lin0.weight, lin1.weight, ... of shape (1, channels, 1, 1) for the linear heads.
"""
import argparse
import json
import os
import re
import struct
import sys

NETWORKS = ("alex", "squeeze", "vgg")


def tensor_name(key):
    """Returns the name in the file for a key of lpips.LPIPS.state_dict(), or None if it is not a weight."""
    head = re.fullmatch(r"lin(\d+)\.model\.\d+\.weight", key)
    if head:
        return f"lin{head.group(1)}.weight"
    # The layers in slices have the same numbers as torchvision's modules.
    layer = re.fullmatch(r"net\.slice\d+\.(\d+\..*(?:weight|bias))", key)
    return f"features.{layer.group(1)}" if layer else None


def tensors_of(state):
    """Returns (shape, bytes) by name for a state dict; values are converted to little-endian float32."""
    tensors = {}
    for key, value in state.items():
        name = tensor_name(key)
        if name is None or name in tensors:  # `lins` contains the heads again
            continue
        array = value.detach().cpu().numpy().astype("<f4")
        tensors[name] = (list(array.shape), array.tobytes())
    return tensors


def write_safetensors(path, tensors):
    header, at = {"__metadata__": {"format": "pt", "source": "lpips 0.1 and torchvision"}}, 0
    for name, (shape, data) in tensors.items():
        header[name] = {"dtype": "F32", "shape": shape, "data_offsets": [at, at + len(data)]}
        at += len(data)
    text = json.dumps(header).encode()
    text += b" " * (-len(text) % 8)
    temporary = f"{path}.tmp-{os.getpid()}"
    try:
        with open(temporary, "wb") as file:
            file.write(struct.pack("<Q", len(text)))
            file.write(text)
            for _, data in tensors.values():
                file.write(data)
        os.replace(temporary, path)
    finally:
        if os.path.exists(temporary):
            os.remove(temporary)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("networks", nargs="+", choices=NETWORKS)
    parser.add_argument("--out", default=".", metavar="DIR", help="folder to write to [.]")
    options = parser.parse_args()
    try:
        import lpips
    except ImportError as error:
        sys.exit(f"error: {error}; install the packages with: pip install lpips torchvision")
    os.makedirs(options.out, exist_ok=True)
    for name in options.networks:
        model = lpips.LPIPS(net=name, version="0.1", verbose=False)
        path = os.path.join(options.out, f"lpips_{name}.safetensors")
        tensors = tensors_of(model.state_dict())
        write_safetensors(path, tensors)
        print(f"{path}: {len(tensors)} tensors, {os.path.getsize(path)} bytes")


if __name__ == "__main__":
    main()
