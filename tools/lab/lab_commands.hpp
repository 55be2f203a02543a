// SPDX-License-Identifier: Apache-2.0
// These functions declare the subcommands of `ubs-lab`. Each function declares one, with its options.
#pragma once

#include "tools/common/subcommands.hpp"

namespace ubs::tools {

Command add_gradients(CLI::App& root);
Command add_compare(CLI::App& root);
Command add_bench(CLI::App& root);
Command add_stress(CLI::App& root);
Command add_tune(CLI::App& root);
Command add_accuracy(CLI::App& root);

}  // namespace ubs::tools
