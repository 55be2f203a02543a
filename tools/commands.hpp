// SPDX-License-Identifier: Apache-2.0
// These functions declare the subcommands of `ubs`. Each function declares one, with its options.
#pragma once

#include "tools/common/subcommands.hpp"

namespace ubs::tools {

Command add_train(CLI::App& root);
Command add_plan(CLI::App& root);
Command add_reduce(CLI::App& root);
Command add_render(CLI::App& root);
Command add_view(CLI::App& root);
Command add_eval(CLI::App& root);
Command add_metrics(CLI::App& root);
Command add_convert(CLI::App& root);
Command add_info(CLI::App& root);
Command add_synth(CLI::App& root);
Command add_pack(CLI::App& root);
Command add_devices(CLI::App& root);
Command add_cameras(CLI::App& root);
Command add_report(CLI::App& root);
Command add_web(CLI::App& root);

}  // namespace ubs::tools
