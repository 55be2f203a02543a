// SPDX-License-Identifier: Apache-2.0
// Tests rendering for viewers during a training: no image is started when the training is about to end.
#include "host/look/serve/live.hpp"

#include <catch2/catch.hpp>
#include <future>

#include "host/base/error.hpp"
#include "tests/pipeline/training_runs.hpp"
#include "tests/support/device_fixture.hpp"
#include "tests/web/http_client.hpp"

namespace ubs::serve {
namespace {

using namespace std::chrono_literals;

TEST_CASE("live: a pending request is not rendered while the training stops, but after it has stopped") {
  const auto device = devices_under_test().at(0);
  const test::Data data = test::synthetic("glossy", 16, 3);
  const TrainSettings settings = test::short_run(3, 20, 100);
  Trainer trainer(*device, settings, data.train, test::kNone, test::start(settings));
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
    // These calls are like those after Ctrl-C. The request arrives long before the last of them, and viewers
    // have not used up their share of the time.
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

}  // namespace
}  // namespace ubs::serve
