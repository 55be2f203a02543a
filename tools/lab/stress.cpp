// SPDX-License-Identifier: Apache-2.0
// ubs-lab stress: stiff and extreme cases and a randomised campaign against float64 on a device; a failing
// case is shrunk and saved as files that other subcommands read.
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <regex>

#include "host/base/error.hpp"
#include "host/base/file.hpp"
#include "host/base/paths.hpp"
#include "host/base/stopwatch.hpp"
#include "host/base/text.hpp"
#include "host/stress/campaign.hpp"
#include "host/stress/report.hpp"
#include "tools/common/bench_environment.hpp"
#include "tools/common/interrupt.hpp"
#include "tools/common/model_session.hpp"
#include "tools/common/number_check.hpp"
#include "tools/common/output.hpp"
#include "tools/common/output_files.hpp"
#include "tools/common/version.hpp"
#include "tools/lab/commands.hpp"

namespace ubs::tools {
namespace {

namespace fs = std::filesystem;
using namespace ubs::stress;

constexpr int kFailureExitCode = 9;

struct StressOptions {
  std::string device, raster = "auto", regex, json, out, replay;
  std::uint64_t seed = 1, first = 0, cases = 3000;
  bool list = false, overwrite = false;
};

std::regex pattern_of(const std::string& text) {
  try {
    return std::regex(text);
  } catch (const std::regex_error& error) {
    fail(ErrorKind::usage, "--run '{}' is not a regular expression: {}", text, error.what());
  }
}

class StressRun {
 public:
  StressRun(const StressOptions& options, DeviceRunner& runner) : options_(options), runner_(runner) {}

  void rows(const std::vector<Row>& rows) {
    say("{}\n", stress::table_header());
    for (const Row& row : rows) {
      if (guard_.interrupted()) return;
      add(run_row(row, runner_));
      const RowReport& report = reports.back();
      if (report.outcome == stress::Outcome::failed) ++failed;
      if (report.failing) save(*report.failing, report.verdict);
    }
  }

  void campaign() {
    CampaignOptions campaign{.seed = options_.seed, .first = options_.first, .cases = options_.cases};
    campaign.on_progress = [this](std::uint64_t done, std::uint64_t failures) {
      return progress(done, failures);
    };
    CampaignReport result = run_campaign(runner_, campaign);
    cases = result.cases, failed += result.failed;
    if (line_open_) remark("\n");
    for (RowReport& form : result.forms) add(std::move(form));
    for (const Failure& failure : result.failures) save(failure.c, failure.verdict);
    if (result.failed > result.failures.size())
      say("{} more random cases failed\n", result.failed - result.failures.size());
  }

  bool interrupted() const { return guard_.interrupted(); }

  std::vector<RowReport> reports;
  std::uint64_t cases = 0, failed = 0;

 private:
  void add(RowReport report) {
    say("{}\n", table_row(report));
    flush_out();
    reports.push_back(std::move(report));
  }

  bool progress(std::uint64_t done, std::uint64_t failures) {
    const bool terminal = isatty(STDERR_FILENO) == 1;
    if (shown_.seconds() > (terminal ? 0.5 : 10.0)) {
      shown_.restart();
      remark("{}{}/{} random cases, {} failed{}", terminal ? "\r\x1b[K" : "", done, options_.cases, failures,
             terminal ? "" : "\n");
      line_open_ = terminal;
    }
    return !guard_.interrupted();
  }

  // Shrinks the case and writes it; says how to see it again.
  void save(const Case& c, const Verdict& verdict) {
    const Shrunk shrunk =
        shrink(c, verdict, [this](const Case& smaller) { return examine(smaller, runner_); });
    const fs::path folder =
        (options_.out.empty() ? fs::path("stress-failures") : fs::path(options_.out) / "failures") / c.name;
    save_case(shrunk.smallest, folder);
    const Case& s = shrunk.smallest;
    const std::string where = shell_word(folder.string());
    say("  FAILED {} (seed {}): {}\n    shrunk to {} splats, {}x{} pixels: {}\n    ubs-lab stress --replay "
        "{}\n",
        c.name, c.seed, verdict.problem, s.model.count, s.camera.width, s.camera.height,
        shrunk.verdict.problem, where);
    if (path_exists(folder / "model.ply"))
      say("    ubs render --model {} --data {} --split test --format npy --out {}\n",
          shell_word((folder / "model.ply").string()), where, shell_word(folder.string() + "-drawn"));
  }

  const StressOptions& options_;
  DeviceRunner& runner_;
  InterruptGuard guard_;
  Stopwatch shown_;
  bool line_open_ = false;
};

int replay(const StressOptions& options, DeviceRunner& runner) {
  const Case c = load_case(options.replay);
  const Verdict v = examine(c, runner);
  say("{}: {}\n", c.name,
      v.outcome == stress::Outcome::failed ? v.problem : std::string(to_string(v.outcome)));
  say("{} splats, {} drawn; {} of {} pixels undecided\n", v.splats, v.drawn, v.undecided, v.pixels);
  say("value error {:.3e} (rounding of the inputs {:.1e}), gradient error {:.3e} ({:.1e}) in {}\n",
      v.value_error, v.value_floor, v.gradient_error, v.gradient_floor,
      v.worst_group.empty() ? "no group" : v.worst_group);
  return v.outcome == stress::Outcome::failed ? kFailureExitCode : 0;
}

int run(const StressOptions& options) {
  if (!options.json.empty() || !options.out.empty()) files_before_output();
  const std::regex pattern = pattern_of(options.regex);
  std::vector<Row> rows = all_rows();
  std::erase_if(rows, [&](const Row& row) { return !std::regex_search(row.name, pattern); });
  const bool random = std::regex_search("random", pattern) && options.cases > 0;
  if (rows.empty() && !random)
    fail(ErrorKind::usage, "--run '{}' matches no row; --list shows them", options.regex);
  if (options.list) {
    for (const Row& row : rows) say("{:<22} {}\n", row.name, row.what);
    say("{:<22} {}\n", "random", "randomised campaign: --seed, --first, --cases");
    return 0;
  }
  const auto held = take_folder(options.out, {"stress.md"}, {}, options.overwrite);
  check_output_files({options.json}, {}, options.overwrite);
  const std::unique_ptr<Device> device = open_device(options.device);
  DeviceRunner runner(*device, raster_kind(options.raster, device->info()));
  if (!options.replay.empty()) return replay(options, runner);

  const Stopwatch watch;
  StressRun stress(options, runner);
  stress.rows(rows);
  if (random && !stress.interrupted()) stress.campaign();
  say("{}", summary_text(stress.reports));
  const RunFacts facts{describe(device->info()),
                       runner.raster() == RasterKind::cpu ? "cpu" : "gpu",
                       version_line(),
                       utc_date(),
                       command_line(),
                       options.seed,
                       options.first,
                       stress.cases,
                       watch.seconds()};
  if (!options.json.empty())
    write_file_atomically(options.json, json_file_text(to_json(stress.reports, facts)));
  if (!options.out.empty())
    write_file_atomically(fs::path(options.out) / "stress.md", page(stress.reports, facts));
  if (stress.interrupted()) return kInterruptedExitCode;
  say("{} in {:.0f} s\n", stress.failed == 0 ? "passed" : fmt::format("{} FAILED", stress.failed),
      facts.seconds);
  return stress.failed == 0 ? 0 : kFailureExitCode;
}

}  // namespace

Command add_stress(CLI::App& root) {
  const auto options = std::make_shared<StressOptions>();
  CLI::App* app =
      root.add_subcommand("stress", "Stiff, extreme and random cases against float64 (docs/stability.md)");
  app->add_option("--run", options->regex, "only rows whose name contains a match; 'random' is the campaign")
      ->type_name("REGEX");
  app->add_flag("--list", options->list, "print the rows and stop");
  add_device_option(*app, options->device);
  app->add_option("--raster", options->raster, "auto|cpu|gpu: rasteriser and lists")
      ->check(CLI::IsMember({"auto", "cpu", "gpu"}))
      ->type_name("KIND");
  app->add_option("--seed", options->seed, "of the random cases [1]")->check(not_negative())->type_name("S");
  // Of -1 an unsigned number would be a campaign without end.
  app->add_option("--cases", options->cases, "random cases; 0: none [3000]")
      ->check(not_negative())
      ->type_name("N");
  app->add_option("--first", options->first, "number of the first random case [0]")
      ->check(not_negative())
      ->type_name("K");
  CLI::Option* replay =
      app->add_option("--replay", options->replay, "the one case that an earlier run saved in this folder")
          ->type_name("DIR");
  app->add_option("--json", options->json, "write all results to this file")->type_name("FILE");
  app->add_option("--out", options->out,
                  "folder for stress.md and failing cases [failures in stress-failures]")
      ->type_name("DIR");
  for (const char* campaign : {"--run", "--list", "--seed", "--cases", "--first", "--json", "--out"})
    replay->excludes(app->get_option(campaign));
  add_overwrite_option(*app, options->overwrite);
  return {app, [options] { return run(*options); }};
}

}  // namespace ubs::tools
