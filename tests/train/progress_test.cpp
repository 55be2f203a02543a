// SPDX-License-Identifier: Apache-2.0
// Tests the progress lines of commands with a simulated clock: if stderr is not a terminal, an update prints
// a line if at least ten seconds have passed since the last line. Also tests the remaining time in these
// lines.
#include "tools/common/progress.hpp"

#include <catch2/catch.hpp>
#include <cmath>

#include "tests/support/on_stderr.hpp"
#include "tests/support/simulated_time.hpp"

namespace ubs {
namespace {

StepReport report_at(int iteration, double seconds) {
  return {.iteration = iteration, .iterations = 1000, .seconds = seconds, .splats = 50, .loss = 0.25};
}

}  // namespace

TEST_CASE("progress: without a terminal, a line is printed at most every ten seconds", "[time]") {
  for (const double each : {0.011, 0.5, 1.0, 25.0, 600.0}) {
    test::SimulatedTime time;
    const std::string text = test::on_stderr([&] {
      tools::Progress progress(1000, false, time);
      for (int i = 10; i <= 1000; i += 10) {
        time.advance(10 * each);
        progress.update(report_at(i, i * each));
      }
    });
    INFO(each << " s per step\n" << text);
    const auto lines = std::count(text.begin(), text.end(), '\n');
    // update() is called every 10 iterations. It prints a line if at least 10 s have passed since the last
    // line.
    const double between = std::max(10 * each, std::ceil(10 / (10 * each)) * 10 * each);
    CHECK(lines == static_cast<long>(1000 * each / between + 1e-9));
    CHECK(text.find('\r') == std::string::npos);
    if (lines > 0) CHECK(text.find(fmt::format("{:.1f} it/s", 1 / each)) != std::string::npos);
  }
}

TEST_CASE("progress: the remaining time is reported by the run, or computed from its speed", "[time]") {
  test::SimulatedTime time;
  const std::string text = test::on_stderr([&] {
    tools::Progress progress(1000, false, time);
    time.advance(20);
    progress.update(report_at(400, 20));
    time.advance(20);
    StepReport budgeted = report_at(600, 40);
    budgeted.seconds_left = 7;
    progress.update(budgeted);
    time.advance(600);  // a pause
    progress.update(report_at(601, 640));
  });
  CHECK(text.find("400/1000  20.0 it/s  loss 0.2500  50 splats  ETA 30 s\n") != std::string::npos);
  CHECK(text.find("600/1000  10.0 it/s  loss 0.2500  50 splats  ETA 7.0 s\n") != std::string::npos);
  CHECK(text.find("601/1000  0.0 it/s") != std::string::npos);
}

TEST_CASE("progress: counters also print a line every ten seconds", "[time]") {
  test::SimulatedTime time;
  const std::string text = test::on_stderr([&] {
    tools::CountProgress progress(100, "frames", false, time);
    for (std::size_t i = 1; i <= 100; ++i) {
      time.advance(1);
      progress.update(i);
    }
  });
  CHECK(std::count(text.begin(), text.end(), '\n') == 10);
  CHECK(text.find("50/100 frames  1.0 per second  ETA 50 s\n") != std::string::npos);
}

}  // namespace ubs
