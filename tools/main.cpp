// SPDX-License-Identifier: Apache-2.0
// This is the main program of the executable `ubs`, which trains, renders and converts models.
#include "tools/commands.hpp"
#include "tools/common/interrupt.hpp"

namespace {

using namespace ubs::tools;

constexpr const char *kFirst = "First steps", *kLearn = "Learn", *kLook = "Look", *kConvert = "Convert",
                     *kDevices = "Devices";

constexpr CommandEntry kCommands[] = {
    {add_train, kFirst, "ubs train photos", "ubs train photos --out run --budget 10m", true},
    {add_view, kFirst, "ubs view run", "ubs view run photos"},
    {add_render, kFirst, "ubs render run --video flight.mp4",
     "ubs render run photos --split test --out pictures", true},
    {add_cameras, kLearn, "ubs cameras photos", "ubs cameras photos --order sequence"},
    {add_plan, kLearn, "ubs plan photos", "ubs plan photos --dim 7 --iterations 10000"},
    {add_reduce, kLearn, "ubs reduce run --out small.ply",
     "ubs reduce run photos --max-loss-db 0.2 --out small.ply"},
#ifdef UBS_WITH_OPENCV
    {add_report, kLook, "ubs report run", "ubs report run other --out both.html"},
    {add_web, kLook, "ubs web run --out model.html", "ubs web run photos --out model.ubsz"},
#endif
    {add_eval, kLook, "ubs eval run", "ubs eval scan.ply photos --lpips alex --json", true},
    {add_metrics, kLook, "ubs metrics truth.png render.png", "ubs metrics truths renders --out metrics.json"},
    {add_info, kLook, "ubs info run", "ubs info photos --json"},
    {add_convert, kConvert, "ubs convert scan.spz scan.ply --to ubs", "ubs convert run scene.ply --to 3dgs"},
    {add_pack, kConvert, "ubs pack photos --out photos.ubsd",
     "ubs pack photos --downscale 2 --out half.ubsd"},
    {add_synth, kConvert, "ubs synth glossy --out data", "ubs synth orbit --out data --size 200"},
    {add_devices, kDevices, "ubs devices --doctor", "ubs devices --check --device gpu --dim 6"},
};

}  // namespace

int main(int argc, char** argv) {
  const Program program{
      "ubs",
      "ubs: universal beta splatting. Trains and renders splat models of 3 to 11 dimensions.",
      {{kInterruptedExitCode, "interrupted (train and render keep the results so far)"}},
      kCommands};
  return run_program(program, argc, argv);
}
