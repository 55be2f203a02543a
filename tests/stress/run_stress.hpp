// SPDX-License-Identifier: Apache-2.0
// The stress run as a command: stiff, extreme and random cases of a device against float64
// (docs/stability.md).
#pragma once

namespace ubs::stress {

// Runs the stress test cases with the command line of Catch2 (names, tags, reporters, --list-tests) and the
// options
// --device, --raster, --seed, --first and --cases. argv[0] is the name of the command as the user types it.
// Returns 0, 9 if a test case failed, or 2 after a wrong option, which Catch2 has reported on stderr. Throws
// Error(usage) if a value is out of range or no test case has the name, and the errors of open_device(). Call
// it once per process: Catch2 has one session.
int run_stress(int argc, char** argv);

}  // namespace ubs::stress
