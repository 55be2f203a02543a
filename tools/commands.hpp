// SPDX-License-Identifier: Apache-2.0
// The subcommands of the executable. Each add_* declares options and help on `root` and returns what to run
// once the command line has been parsed; the result of run() is the exit code.
#pragma once

#include <functional>

namespace CLI {
class App;
}

namespace ubs::tools {

struct Command {
  CLI::App* app;
  std::function<int()> run;
};

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
Command add_gradients(CLI::App& root);
Command add_compare(CLI::App& root);
Command add_devices(CLI::App& root);
Command add_bench(CLI::App& root);
Command add_tune(CLI::App& root);
Command add_accuracy(CLI::App& root);
Command add_cameras(CLI::App& root);
Command add_report(CLI::App& root);
Command add_web(CLI::App& root);

}  // namespace ubs::tools
