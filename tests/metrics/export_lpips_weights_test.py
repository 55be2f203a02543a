#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""Tests tools/export_lpips_weights.py without the Python packages lpips and torch, from which the script takes the
weights. Instead of lpips.LPIPS, the test uses objects with the same keys as in lpips 0.1: slices of torchvision's
`features`, heads after a dropout, and a second copy of all heads in `lins`. Checks names, shapes, the order of bytes
and the format of the file."""
import importlib.util
import json
import pathlib
import struct
import sys
import tempfile
import types

ROOT = pathlib.Path(__file__).resolve().parents[2]
# For each slice, the numbers of the modules with weights in torchvision's `features`, and the last number of channels.
SLICES = {
    "alex": [((0,), 64), ((3,), 192), ((6,), 384), ((8,), 256), ((10,), 256)],
    "vgg": [((0, 2), 64), ((5, 7), 128), ((10, 12, 14), 256), ((17, 19, 21), 512), ((24, 26, 28), 512)],
    "squeeze": [((0,), 64), ((3, 4), 128), ((6, 7), 256), ((9,), 384), ((10,), 384), ((11,), 512), ((12,), 512)],
}


class Value:
    """Replaces a tensor in the script. The values ascend, so that a wrong order of the bytes is detected."""

    def __init__(self, shape, first):
        self.shape, self.first, self.type = shape, first, None

    def detach(self):
        return self

    cpu = numpy = detach

    def astype(self, kind):
        assert kind == "<f4", kind
        return self

    def tobytes(self):
        count = 1
        for extent in self.shape:
            count *= extent
        return struct.pack(f"<{count}f", *(self.first + i for i in range(count)))


def state_of(network):
    """Returns two dictionaries: one with the keys of lpips.LPIPS(net=network).state_dict() and small tensors, and
    one with the names, shapes and bytes that the script must write for them."""
    state, expected = {"scaling_layer.shift": Value((1, 3, 1, 1), 0), "scaling_layer.scale": Value((1, 3, 1, 1), 0)}, {}

    def add(key, name, shape):
        state[key] = Value(shape, len(state))
        expected[name] = (list(shape), state[key].tobytes())

    for number, (modules, _) in enumerate(SLICES[network], 1):
        for module in modules:
            parts = ("squeeze.", "expand1x1.", "expand3x3.") if network == "squeeze" and module else ("",)
            for part in parts:
                for kind, shape in (("weight", (2, 3, 1, 1)), ("bias", (2,))):
                    add(f"net.slice{number}.{module}.{part}{kind}", f"features.{module}.{part}{kind}", shape)
    for head, (_, channels) in enumerate(SLICES[network]):
        add(f"lin{head}.model.1.weight", f"lin{head}.weight", (1, channels, 1, 1))
    for head, (_, channels) in enumerate(SLICES[network]):
        state[f"lins.{head}.model.1.weight"] = Value((1, channels, 1, 1), -1)
    return state, expected


def read_safetensors(path):
    data = path.read_bytes()
    length = struct.unpack("<Q", data[:8])[0]
    assert length % 8 == 0, "the header is not aligned"
    header, body = json.loads(data[8:8 + length]), data[8 + length:]
    header.pop("__metadata__")
    assert sum(e["data_offsets"][1] - e["data_offsets"][0] for e in header.values()) == len(body)
    assert all(e["dtype"] == "F32" for e in header.values())
    return {name: (e["shape"], body[slice(*e["data_offsets"])]) for name, e in header.items()}


def main():
    spec = importlib.util.spec_from_file_location("export", ROOT / "tools" / "export_lpips_weights.py")
    script = importlib.util.module_from_spec(spec)
    sys.dont_write_bytecode = True
    spec.loader.exec_module(script)
    assert set(script.NETWORKS) == set(SLICES)
    states = {name: state_of(name) for name in SLICES}
    sys.modules["lpips"] = types.SimpleNamespace(
        LPIPS=lambda net, version, verbose: types.SimpleNamespace(state_dict=lambda: states[net][0]))
    with tempfile.TemporaryDirectory() as folder:
        sys.argv = ["export_lpips_weights.py", *SLICES, "--out", folder]
        script.main()
        for name, (_, expected) in states.items():
            assert read_safetensors(pathlib.Path(folder) / f"lpips_{name}.safetensors") == expected, name
        assert len(list(pathlib.Path(folder).iterdir())) == len(SLICES), "temporary files remain"
    assert len(states["vgg"][1]) == 2 * 13 + 5


if __name__ == "__main__":
    main()
