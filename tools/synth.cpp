// SPDX-License-Identifier: Apache-2.0
// ubs synth: writes a procedural scene as a data folder in the Blender / D-NeRF layout.
#include <CLI/CLI.hpp>
#include <memory>

#include "host/dataset/synthetic.hpp"
#include "tools/commands.hpp"
#include "tools/common/number_check.hpp"
#include "tools/common/output.hpp"
#include "tools/common/output_files.hpp"

namespace ubs::tools {
namespace {

struct SynthOptions {
  SyntheticOptions scene;
  std::string out;
  int size = 0;
};

int run(SynthOptions options) {
  files_before_output();
  if (options.size > 0) options.scene.width = options.scene.height = options.size;
  export_synthetic(options.scene, options.out);
  say("scene {}: {} train, {} test, {} val views of {}x{} in {}\n", options.scene.scene,
      options.scene.train_views, options.scene.test_views, options.scene.val_views, options.scene.width,
      options.scene.height, options.out);
  return 0;
}

}  // namespace

Command add_synth(CLI::App& root) {
  const auto options = std::make_shared<SynthOptions>();
  SyntheticOptions& scene = options->scene;
  CLI::App* app = root.add_subcommand("synth", "Generate a synthetic data set");
  app->add_option("scene", scene.scene, "glossy (static, reflections), orbit (dynamic), cloud (volume)")
      ->required()
      ->type_name("SCENE");
  app->add_option("--out", options->out, "data folder to write")->required()->type_name("DIR");
  CLI::Option* width = app->add_option("--width", scene.width, "image width")->capture_default_str();
  CLI::Option* height = app->add_option("--height", scene.height, "image height")->capture_default_str();
  app->add_option("--size", options->size, "width and height")
      ->check(from_to(1, 8192))
      ->excludes(width)
      ->excludes(height);
  app->add_option("--views", scene.train_views, "number of training views")->capture_default_str();
  app->add_option("--test-views", scene.test_views, "number of test views")->capture_default_str();
  app->add_option("--val-views", scene.val_views, "number of validation views")->capture_default_str();
  app->add_option("--supersampling", scene.supersampling, "number of rays per pixel along each axis")
      ->capture_default_str();
  app->add_option("--seed", scene.seed, "seed of the camera positions and of the shape of the cloud")
      ->check(not_negative())
      ->capture_default_str();
  add_overwrite_option(*app, scene.overwrite);
  return {app, [options] { return run(*options); }};
}

}  // namespace ubs::tools
