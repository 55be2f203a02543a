// SPDX-License-Identifier: Apache-2.0
// ubs view: shows a finished model in the browser. ubs renders the images and serves the page.
#include <fcntl.h>
#include <spawn.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <csignal>
#include <cstdlib>
#include <memory>

#include "host/base/child_process.hpp"
#include "host/look/serve/live.hpp"
#include "host/run/open_data.hpp"
#include "tools/commands.hpp"
#include "tools/common/interrupt.hpp"
#include "tools/common/model_options.hpp"
#include "tools/common/number_check.hpp"
#include "tools/common/page_views.hpp"
#include "tools/common/path_options.hpp"
#include "tools/common/streams.hpp"

namespace ubs::tools {
namespace {

struct ViewOptions : ModelOptions {
  explicit ViewOptions(CLI::App& app) : ModelOptions(app, drawing_keys()) { split = "train"; }
  serve::Address address;
  std::string up;
};

bool has_desktop() {
  for (const char* name : {"DISPLAY", "WAYLAND_DISPLAY"})
    if (const char* value = std::getenv(name); value && *value) return true;
  return false;
}

// Opens the address with xdg-open. The browser gets a process group of its own, so that Ctrl-C in the
// terminal ends ubs and not the browser. Failures are ignored, because the address is printed anyway. ubs
// does not wait for xdg-open, because with some browsers it returns only when the browser is closed.
void open_browser(std::string url) {
  std::string program = "xdg-open";
  char* arguments[] = {program.data(), url.data(), nullptr};
  posix_spawn_file_actions_t files;
  posix_spawn_file_actions_init(&files);
  posix_spawn_file_actions_addopen(&files, STDIN_FILENO, "/dev/null", O_RDONLY, 0);
  posix_spawn_file_actions_addopen(&files, STDOUT_FILENO, "/dev/null", O_WRONLY, 0);
  posix_spawn_file_actions_adddup2(&files, STDOUT_FILENO, STDERR_FILENO);
  posix_spawnattr_t attributes;
  posix_spawnattr_init(&attributes);
  sigset_t signals;
  sigemptyset(&signals);
  for (const int number : kSignalsOfChildren) sigaddset(&signals, number);
  posix_spawnattr_setsigdefault(&attributes, &signals);
  posix_spawnattr_setflags(&attributes, POSIX_SPAWN_SETPGROUP | POSIX_SPAWN_SETSIGDEF);
  pid_t child = 0;
  posix_spawnp(&child, program.c_str(), &files, &attributes, arguments, environ);
  posix_spawnattr_destroy(&attributes);
  posix_spawn_file_actions_destroy(&files);
}

int run(ViewOptions& options) {
  serve::Server server(options.address);
  const LoadedModel loaded = options.load();
  RunData run;
  if (!options.data.empty()) run = use_run_data(options.model, options.data, options.settings.resolve());
  const TrainSettings settings = drawing_settings(options.settings, loaded, options.model, run);
  FrameHints hints = frame_hints(loaded);
  if (!options.up.empty()) hints.up = parse_vector("--up", options.up);
  const Split views = page_views(options, loaded, settings, run.opened, hints);
  const serve::Scene scene =
      served_scene(options.model, loaded.model, views, are_captured(options, loaded), hints);
  ModelSession session(options.device, loaded.model, {.name = "view", .views = scene.cameras}, settings,
                       false);
  const EndOnRequest guard("");
  remark("ubs: live at {}\n", server.url());
  if (has_desktop()) open_browser(server.url());
  serve::serve_model(server, session, loaded.model, scene);
  return kInterruptedExitCode;
}

}  // namespace

Command add_view(CLI::App& root) {
  CLI::App* app = root.add_subcommand("view", "Show a model in the browser, rendered by this program");
  const auto options = std::make_shared<ViewOptions>(*app);
  app->get_option("--split")->description("train, val or test [train]");
  app->add_option("--up", options->up, kUpHelp)->type_name("X,Y,Z|AXIS");
  app->add_option("--port", options->address.port, "port of the page; 0: any free port [8080]")
      ->check(from_to(0, 65535))
      ->type_name("PORT");
  app->add_option(
         "--host", options->address.host,
         "address to listen on; requests from other machines need the token that is printed [127.0.0.1]")
      ->type_name("HOST");
  return {app, [options] { return run(*options); }};
}

}  // namespace ubs::tools
