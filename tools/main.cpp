// SPDX-License-Identifier: Apache-2.0
// The executable `ubs`: finds the subcommand, and turns every failure into one line on stderr and the
// exit code of its kind (host/base/error.hpp).
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <cstdlib>
#include <filesystem>
#include <iostream>
#include <new>
#include <string>
#include <vector>

#include "host/base/error.hpp"
#include "host/base/text.hpp"
#include "host/base/warning.hpp"
#include "host/device/registry.hpp"
#include "host/spec/settings.hpp"
#include "tools/commands.hpp"
#include "tools/common/job.hpp"
#include "tools/common/streams.hpp"
#include "tools/common/version.hpp"
#include "tools/help.hpp"

namespace {

constexpr const char* kFooter =
    "\nExit codes: 0 success, 1 internal error, 2 wrong usage, 3 unusable data or a result that cannot be\n"
    "written, 4 device, 5 kernels do not build, 6 out of memory, 7 not finite, 8 worse than the baseline\n"
    "(bench, accuracy), 10 a device computes wrong results, 130 interrupted (train, render, bench and\n"
    "accuracy keep the results so far).\n"
    "Environment: UBS_DEVICE (as --device), UBS_KERNEL_DIR (kernel sources from disk), UBS_SYNC=1 (wait\n"
    "after every kernel and name the one that fails), UBS_TUNING=off (ignore what `ubs tune` stored),\n"
    "UBS_TUNING_DIR (where it is stored), UBS_HUGE_PAGES=0 (ordinary pages for buffers of CPU devices),\n"
    "UBS_KERNEL_CACHE (where compiled kernels are kept, PoCL's among them; off: nowhere),\n"
    "UBS_RANK_PATIENCE (seconds that a rank of a job waits for the others: docs/cluster.md),\n"
    "UBS_CHECK=off (take devices that were not checked, or failed: docs/check.md).";

int report(std::string message, int code) {
  std::replace(message.begin(), message.end(), '\n', ' ');
  message = "ubs: error: " + ubs::tools::error_prefix() + ubs::encode_text(message) +
            '\n';                      // names may hold anything
  std::cerr << message << std::flush;  // in one piece: other ranks have the same stderr
  return ubs::tools::end_with_error(code);
}

int report_parse_error(const CLI::ParseError& error, const CLI::App& root,
                       const std::vector<std::string>& arguments) {
  const int code = ubs::exit_code(ubs::ErrorKind::usage);
  const auto used = root.get_subcommands();
  if (used.empty() && !arguments.empty() && !arguments.front().starts_with('-'))
    return report(ubs::tools::unknown_subcommand(root, arguments.front()), code);
  const CLI::App* app = used.empty() ? &root : used.front();
  const bool unknown = dynamic_cast<const CLI::ExtrasError*>(&error) != nullptr;
  return report(
      fmt::format("{}{} (see '{} --help')", error.what(),
                  unknown ? ubs::tools::suggest_option(*app, arguments) : "", ubs::tools::full_name(*app)),
      code);
}

// Others would do, and write, everything as often as there are ranks.
void check_ranks(const CLI::App& command) {
  constexpr std::array kShared{"eval", "render", "train"};
  if (ubs::tools::ranks().size() > 1 && std::ranges::find(kShared, command.get_name()) == kShared.end())
    ubs::fail(ubs::ErrorKind::usage, "'{}' is a command of one process: leave out mpirun",
              ubs::tools::full_name(command));
}

int run(int argc, char** argv) {
  ubs::tools::join();
  CLI::App root(
      "ubs: universal beta splatting. Learns, renders and measures splat models of 3 to 11 dimensions.",
      "ubs");
  root.set_version_flag("--version", ubs::tools::version_line());
  root.footer(kFooter);
  root.require_subcommand(1);
  using namespace ubs::tools;
  prepare_help(root);
  const std::vector<Command> commands{
      add_train(root),   add_plan(root),    add_render(root),   add_eval(root),      add_info(root),
      add_synth(root),   add_pack(root),    add_convert(root),  add_gradients(root), add_devices(root),
      add_compare(root), add_bench(root),   add_accuracy(root), add_tune(root),      add_metrics(root),
      add_reduce(root),  add_cameras(root), add_view(root),
#ifdef UBS_WITH_OPENCV
      add_report(root),  add_web(root),
#endif
  };
  arrange_commands(root);
  // An option takes one word, a list its commas: what comes behind it is a folder or a model.
  for (const Command& command : commands)
    for (CLI::Option* option : command.app->get_options()) {
      if (option->get_positional()) continue;
      option->allow_extra_args(false);
      if (option->get_delimiter() != '\0')
        option->expected(1)->multi_option_policy(CLI::MultiOptionPolicy::TakeAll)->allow_extra_args(false);
    }
  if (argc == 1) {
    ubs::tools::say("{}", root.help());
    return 0;
  }
  const std::vector<std::string> arguments(argv + 1, argv + argc);
  try {
    root.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    if (error.get_exit_code() == 0) return root.exit(error);  // --help, --version
    return report_parse_error(error, root, arguments);
  }
  for (const Command& command : commands)
    if (command.app->parsed()) {
      check_ranks(*command.app);
      return command.run();
    }
  ubs::fail(ubs::ErrorKind::internal, "no subcommand ran");
}

int run_reporting_errors(int argc, char** argv) {
  try {
    return run(argc, argv);
  } catch (const ubs::tools::ReaderGone&) {
    return ubs::exit_code(ubs::ErrorKind::data);
  } catch (const ubs::Error& error) {
    return report(error.what(), ubs::exit_code(error.kind()));
  } catch (const std::bad_alloc&) {
    return report("out of memory: use fewer splats, smaller images (--downscale) or fewer views",
                  ubs::exit_code(ubs::ErrorKind::memory));
  } catch (const std::filesystem::filesystem_error& error) {  // host/base/paths.hpp should have had it
    return report(fmt::format("{}: {}", error.path1().string(), error.code().message()),
                  ubs::exit_code(ubs::ErrorKind::data));
  } catch (const std::exception& error) {
    return report(fmt::format("internal: {}", error.what()), ubs::exit_code(ubs::ErrorKind::internal));
  }
}

void log_to_stderr(ubs::LogLevel level, const std::string& text) {
  if (!ubs::tools::ranks().first()) return;  // the first one says the same
  if (level == ubs::LogLevel::warning)
    ubs::tools::remark("ubs: warning: {}\n", ubs::encode_text(text));
  else if (isatty(STDERR_FILENO) == 1)
    ubs::tools::remark("ubs: {}\n", ubs::encode_text(text));
}

// Only the executable changes the environment: the library may run in a process that others share. What the
// user has set stays.
void prepare_environment() {
  setenv("OPENCV_IO_ENABLE_OPENEXR", "1", 0);  // OpenCV's EXR decoder is disabled by default
  setenv("OPENCV_FFMPEG_LOGLEVEL", "-8", 0);   // encoders write to stderr; ubs reports their errors itself
  setenv("OPENCV_FFMPEG_CAPTURE_OPTIONS",      // a second barrier beside that of host/data/video.cpp
         "format_whitelist;avi,matroska,mov,mpegts,webm|protocol_whitelist;file", 0);
  ubs::keep_driver_caches([](const char* name, const char* value) { setenv(name, value, 1); });
}

}  // namespace

int main(int argc, char** argv) {
  prepare_environment();
  ubs::tools::prepare_streams();
  ubs::set_log(log_to_stderr);
  std::string complaint;
  const int code = ubs::tools::finish_streams(run_reporting_errors(argc, argv), complaint);
  if (!complaint.empty()) return report(complaint, code);
  ubs::tools::leave();
  return code;
}
