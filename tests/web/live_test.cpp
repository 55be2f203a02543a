// SPDX-License-Identifier: Apache-2.0
// Tests LiveTraining, which renders images for viewers during training: no image is rendered while the
// training is about to end, and the final model is shown as long as a viewer sends requests.
#include "host/look/serve/live.hpp"

#include <catch2/catch.hpp>
#include <future>

#include "host/base/error.hpp"
#include "tests/pipeline/training_runs.hpp"
#include "tests/support/device_fixture.hpp"
#include "tests/support/simulated_time.hpp"
#include "tests/web/http_client.hpp"

namespace ubs::serve {
namespace {

using namespace std::chrono_literals;

TEST_CASE("live: a request that arrives while training stops is rendered after training has stopped") {
  const auto device = devices_under_test().at(0);
  const test::Data data = test::synthetic("glossy", 16, 3);
  const TrainSettings settings = test::short_run(3, 20, 100);
  Trainer trainer(*device, settle(settings), data.train, test::kNone, test::start(settings));
  Server server({"127.0.0.1", 0});
  LiveTraining live(server, 100, *device, trainer, settings,
                    {.title = "test", .frame = {}, .cameras = data.train.views});
  std::future<Answer> answer;
  bool drawn_late = false;
  trainer.run([&](const StepReport& report) {
    if (report.iteration == 1) {
      const auto ask = [&] { return answer_of(server, post(request_json().dump())); };
      live.step(report, true);
      answer = std::async(std::launch::async, ask);
      return true;
    }
    // `false` means that training is about to end, as after Ctrl-C. The request arrives long before the last
    // iteration, and viewers have not used up their share of the time, so nothing else prevents rendering.
    live.step(report, false);
    drawn_late =
        drawn_late || answer.wait_for(report.iteration < 20 ? 10ms : 500ms) == std::future_status::ready;
    return true;
  });
  CHECK(trainer.iteration() == 20);
  CHECK_FALSE(drawn_late);
  CHECK(answer_of(server, get("/state")).body.find("\"pictures\":0") != std::string::npos);
  live.end();
  const Answer got = answer.get();
  CHECK(got.status == 200);
  CHECK(got.head.find("\r\nUbs-Iteration: 20\r\n") != std::string::npos);
}

TEST_CASE("live: the page shows the final model as long as a viewer sends requests") {
  const auto device = devices_under_test().at(0);
  const test::Data data = test::synthetic("glossy", 16, 3);
  const TrainSettings settings = test::short_run(3, 20, 100);
  Trainer trainer(*device, settle(settings), data.train, test::kNone, test::start(settings));
  Server server({"127.0.0.1", 0});
  test::SimulatedTime time;
  LiveTraining live(server, 5, *device, trainer, settings,
                    {.title = "test", .frame = {}, .cameras = data.train.views}, time);
  trainer.run([&](const StepReport& report) {
    live.step(report, report.iteration < 20);
    return true;
  });
  CHECK_FALSE(live.has_viewer());
  CHECK(answer_of(server, get("/state")).body.find("\"ended\":false") != std::string::npos);
  CHECK(live.has_viewer());
  time.advance(3);  // so that end() does not wait for requests
  live.end();
  CHECK(answer_of(server, get("/state")).body.find("\"ended\":true") != std::string::npos);
  live.stay([] { return true; });  // returns at once

  auto answer =
      std::async(std::launch::async, [&] { return answer_of(server, post(request_json().dump())); });
  int left = -1;  // number of calls after the answer
  live.stay([&] {
    if (left < 0 && answer.wait_for(0s) != std::future_status::ready) return false;
    if (++left > 0) time.advance(40);
    return false;
  });
  CHECK(left == 3);  // after 120 s without a request
  CHECK_FALSE(live.has_viewer());
  const Answer got = answer.get();
  CHECK(got.status == 200);
  // The header contains the time for rendering the image, which is 0 because the simulated clock does not
  // advance.
  CHECK(got.head.find("\r\nUbs-Seconds: 0.000000\r\n") != std::string::npos);
}

}  // namespace
}  // namespace ubs::serve
