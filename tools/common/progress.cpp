// SPDX-License-Identifier: Apache-2.0
#include "tools/common/progress.hpp"

#include <unistd.h>

#include <cmath>
#include <utility>

#include "tools/common/streams.hpp"

namespace ubs::tools {
namespace {

constexpr double kTerminalInterval = 0.2, kLogInterval = 10;  // seconds

}  // namespace

Progress::Progress(int iterations, bool silent, const TimeSource& time)
    : time_(time),
      iterations_(iterations),
      silent_(silent),
      terminal_(isatty(STDERR_FILENO) == 1),
      shown_(time.seconds()) {}

void Progress::update(const StepReport& report) {
  iterations_ = report.iterations;
  if (silent_) return;
  const double now = time_.seconds();
  const bool due = now - shown_ >= (terminal_ ? kTerminalInterval : kLogInterval);
  if (!due && !report.test && !(terminal_ && report.iteration == iterations_)) return;
  shown_ = now;
  if (report.seconds > rate_seconds_) {
    const double fresh = (report.iteration - rate_iteration_) / (report.seconds - rate_seconds_);
    rate_ = rate_ > 0 && terminal_ ? 0.8 * rate_ + 0.2 * fresh : fresh;
    rate_iteration_ = report.iteration;
    rate_seconds_ = report.seconds;
  }
  std::string line = fmt::format("{}/{}  {:.1f} it/s", report.iteration, iterations_, rate_);
  if (report.loss) line += fmt::format("  loss {:.4f}", *report.loss);
  line += fmt::format("  {} splats", report.splats);
  if (const double left = report.seconds_left; left > 0)
    line += "  ETA " + duration_text(left);
  else if (rate_ > 0)
    line += "  ETA " + duration_text((iterations_ - report.iteration) / rate_);
  if (report.test)
    line += fmt::format("  test {:.2f} dB, SSIM {:.4f} at {:.1f} s", report.test->mean.psnr_channel_mean,
                        report.test->mean.ssim, report.seconds);
  if (terminal_) {
    remark("\r\x1b[K{}{}", line, report.test ? "\n" : "");
    line_open_ = !report.test;
  } else {
    remark("{}\n", line);
  }
}

void Progress::finish() {
  if (line_open_) remark("\n");
  line_open_ = false;
}

CountProgress::CountProgress(std::size_t total, std::string what, bool silent, const TimeSource& time)
    : time_(time),
      total_(total),
      what_(std::move(what)),
      silent_(silent),
      terminal_(isatty(STDERR_FILENO) == 1),
      start_(time.seconds()),
      shown_(start_) {}

void CountProgress::update(std::size_t done) {
  if (silent_) return;
  const double now = time_.seconds();
  if (now - shown_ < (terminal_ ? kTerminalInterval : kLogInterval) && !(line_open_ && done == total_))
    return;
  shown_ = now;
  const double seconds = now - start_;
  std::string line = fmt::format("{}/{} {}", done, total_, what_);
  if (done > 0 && seconds > 0) {
    const double rate = static_cast<double>(done) / seconds;
    line += fmt::format("  {:.1f} per second  ETA {}", rate,
                        duration_text(static_cast<double>(total_ - done) / rate));
  }
  remark("{}{}{}", terminal_ ? "\r\x1b[K" : "", line, terminal_ ? "" : "\n");
  line_open_ = terminal_;
}

void CountProgress::finish() {
  if (line_open_) remark("\n");
  line_open_ = false;
}

}  // namespace ubs::tools
