// SPDX-License-Identifier: Apache-2.0
// This is the main program of the executable `ubs-lab`, which measures ubs. It measures errors against
// float64 and the times of the same operations, runs numerically difficult and extreme cases, and compares
// devices and back ends.
#include "tools/common/interrupt.hpp"
#include "tools/lab/lab_commands.hpp"

namespace {

using namespace ubs::tools;

constexpr const char *kMeasure = "Measure", *kDevices = "Devices";

constexpr CommandEntry kCommands[] = {
    {add_accuracy, kMeasure, "ubs-lab accuracy --out accuracy", "ubs-lab accuracy run photos --out accuracy"},
#ifdef UBS_WITH_STRESS  // only in builds with tests
    {add_stress, kMeasure, "ubs-lab stress", "ubs-lab stress 'random cases' --cases 500"},
#endif
    {add_bench, kMeasure, "ubs-lab bench --quick", "ubs-lab bench run photos --run iteration"},
    {add_gradients, kMeasure, "ubs-lab gradients run photos --view 0 --out gradients.ply",
     "ubs-lab gradients run photos --view 3 --split train --out gradients.ply"},
    {add_compare, kDevices, "ubs-lab compare --devices cpu,gpu run photos",
     "ubs-lab compare --devices cpu,cuda run photos --train-iterations 100"},
    {add_tune, kDevices, "ubs-lab tune", "ubs-lab tune --device gpu --max-time 120"},
};

}  // namespace

int main(int argc, char** argv) {
  const Program program{
      "ubs-lab",
      "ubs-lab: measures the errors and times of ubs, tests extreme cases, and compares devices.",
      {{8, "slower than the baseline (bench)"},
       {9, "a case failed (stress)"},
       {kInterruptedExitCode, "interrupted (bench, accuracy and stress keep the results so far)"}},
      kCommands};
  return run_program(program, argc, argv);
}
