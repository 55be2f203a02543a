// SPDX-License-Identifier: Apache-2.0
// run_stress() implements the command `ubs-lab stress`, which computes difficult, extreme and random cases on
// a device and compares the results with float64 (docs/stability.md).
#pragma once

namespace ubs::stress {

// Runs the stress tests. Accepts the command line of Catch2 (names, tags, reporters, --list-tests) and the
// options --device, --raster, --seed, --first and --cases. argv[0] is the name of the command as the user
// types it. Returns 0 if all tests passed, 9 if a test failed, and 2 after a wrong option, which Catch2 has
// reported on stderr. Throws Error(usage) if a value is out of range or no test has the given name, and the
// errors of open_device(). It can only be called once per process, because Catch2 allows only one session.
int run_stress(int argc, char** argv);

}  // namespace ubs::stress
