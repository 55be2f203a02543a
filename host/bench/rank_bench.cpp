// SPDX-License-Identifier: Apache-2.0
#include "host/bench/rank_bench.hpp"

#include <algorithm>
#include <array>
#include <functional>

#include "host/base/json.hpp"
#include "host/bench/cpu_clock.hpp"

namespace ubs::bench {
namespace {

constexpr int kWarmUp = 30;  // steps: one of them is sampled by stage (TimedStages)
constexpr int kMoves = 15;

// Passes everything on, and takes the time.
class CountedRanks final : public Communicator {
 public:
  explicit CountedRanks(Communicator& ranks) : ranks_(ranks) {}
  int rank() const override { return ranks_.rank(); }
  int size() const override { return ranks_.size(); }
  bool takes_card_memory() const override { return ranks_.takes_card_memory(); }
  std::unique_ptr<Exchange> start(const Pieces& pieces) override {
    ++exchanges;
    for (std::size_t r = 0; r < pieces.size(); ++r)
      if (r != static_cast<std::size_t>(rank())) bytes += static_cast<double>(pieces[r].size());
    const Stopwatch watch;
    auto counted = std::make_unique<Counted>(*this, ranks_.start(pieces));
    seconds += watch.seconds();
    return counted;
  }
  void sum(std::span<std::uint64_t> values) override {
    ++sums;
    const Stopwatch watch;
    ranks_.sum(values);
    seconds += watch.seconds();
  }

  double seconds = 0, bytes = 0, exchanges = 0, sums = 0;

 private:
  struct Counted final : Exchange {
    Counted(CountedRanks& to, std::unique_ptr<Exchange> on_the_way)
        : to(to), on_the_way(std::move(on_the_way)) {}
    const std::vector<std::uint64_t>& sizes() override {
      const Stopwatch watch;
      const std::vector<std::uint64_t>& sizes = on_the_way->sizes();
      to.seconds += watch.seconds();
      return sizes;
    }
    void receive(std::span<std::byte* const> into) override {
      const Stopwatch watch;
      on_the_way->receive(into);
      to.seconds += watch.seconds();
    }
    CountedRanks& to;
    std::unique_ptr<Exchange> on_the_way;
  };
  Communicator& ranks_;
};

// Median, of calls that begin at the same time.
double together_ms(Communicator& ranks, const std::function<void()>& call) {
  std::vector<double> samples;
  for (int i = 0; i < kMoves; ++i) {
    std::uint64_t nothing = 0;
    ranks.sum(std::span(&nothing, 1));
    const Stopwatch watch;
    call();
    samples.push_back(watch.milliseconds());
  }
  return summarise(samples).median;
}

double moving_ms(Communicator& ranks, const RankMeasurement& m, double exchanges, double sums) {
  if (ranks.size() == 1) return 0;
  auto most = static_cast<std::uint64_t>(m.sent_bytes / std::max(1.0, exchanges) / (ranks.size() - 1));
  ranks.sum(std::span(&most, 1));
  const Bytes piece(most / static_cast<std::uint64_t>(ranks.size()));
  const Pieces pieces(static_cast<std::size_t>(ranks.size()), std::span(piece));
  const double exchange = together_ms(ranks, [&] { ranks.exchange(pieces); });
  std::array<std::uint64_t, 3> words{};
  const double sum = together_ms(ranks, [&] { ranks.sum(words); });
  return exchanges * exchange + sums * sum;
}

Json to_json(const RankMeasurement& m) {
  Json stages = Json::object();
  for (const auto& [stage, ms] : m.stage_ms) stages[stage] = ms;
  return {{"wall_ms", m.wall_ms.median},
          {"wall_ms_least", m.wall_ms.minimum},
          {"samples", m.wall_ms.samples},
          {"mean_ms", m.mean_ms},
          {"cpu_ms", m.cpu_ms},
          {"device_peak_bytes", m.device_peak_bytes},
          {"sent_bytes", m.sent_bytes},
          {"messages", m.messages},
          {"communicating_ms", m.communicating_ms},
          {"moving_ms", m.moving_ms},
          {"stage_ms", std::move(stages)}};
}

}  // namespace

RankMeasurement measure_ranks(Device& device, const BenchScene& scene, const IterationOptions& options,
                              Communicator& ranks) {
  device.reset_peak();
  const Split none{"test", {}};
  CountedRanks counted(ranks);
  Trainer trainer(device, frozen_training(scene, options), scene.views, none, scene.model, counted);
  trainer.run([](const StepReport& report) { return report.iteration < kWarmUp; });
  RankMeasurement m;
  // Before the steps that are measured: the sampled ones wait more.
  for (const StageTime& stage : trainer.stage_times())
    m.stage_ms.emplace_back(stage.stage, 1e3 * stage.seconds / trainer.iteration());
  counted.seconds = counted.bytes = counted.exchanges = counted.sums = 0;
  Sampler sampler(options.limits);
  const Stopwatch watch;
  const double processor = cpu_ms();
  const int first = trainer.iteration();
  int since = first;
  double before = trainer.seconds();
  trainer.run([&](const StepReport& report) {
    if (!report.loss) return true;  // a sample ends where the loss is read, and with it all work is done
    sampler.add(1e3 * (report.seconds - before) / (report.iteration - since));
    before = report.seconds;
    since = report.iteration;
    return !sampler.enough();
  });
  const double steps = trainer.iteration() - first;
  m.wall_ms = sampler.summary();
  m.mean_ms = watch.milliseconds() / steps;
  m.cpu_ms = (cpu_ms() - processor) / steps;
  m.device_peak_bytes = static_cast<double>(device.peak_bytes());
  m.sent_bytes = counted.bytes / steps;
  m.messages = (counted.exchanges + counted.sums) / steps;
  m.communicating_ms = 1e3 * counted.seconds / steps;
  m.moving_ms = moving_ms(ranks, m, counted.exchanges / steps, counted.sums / steps);
  return m;
}

Json gather(Communicator& ranks, const RankMeasurement& own) {
  Json all = Json::array();
  for (const std::string& text : ranks.all_texts(json_text(to_json(own))))
    all.push_back(parse_own_json(text, "measurements of another rank"));
  return all;
}

std::string to_text(const Json& ranks) {
  using Value = std::function<double(const Json&)>;
  const auto member = [](const char* key) -> Value {
    return [key](const Json& m) { return m.at(key).get<double>(); };
  };
  const Value with_others = member("communicating_ms"), moving = member("moving_ms");
  std::string text = fmt::format("{:<34}", "a step [ms]");
  for (std::size_t r = 0; r < ranks.size(); ++r) text += fmt::format("{:>12}", fmt::format("rank {}", r));
  const auto row = [&](const std::string& name, const Value& value) {
    text += fmt::format("\n{:<34}", name);
    for (const Json& m : ranks) text += fmt::format("{:>12.3f}", value(m));
  };
  row("whole, median", member("wall_ms"));
  row("whole, least", member("wall_ms_least"));
  row("whole, mean", member("mean_ms"));
  row("processor time", member("cpu_ms"));
  for (const auto& [name, of_first] : ranks.at(0).at("stage_ms").items())
    row("  " + name, [&](const Json& m) { return m.at("stage_ms").value(name, 0.0); });
  row("with the other ranks", with_others);
  row("  moving", [&](const Json& m) { return std::min(moving(m), with_others(m)); });
  row("  waiting", [&](const Json& m) { return std::max(0.0, with_others(m) - moving(m)); });
  row("messages", member("messages"));
  row("sent [MB]", [](const Json& m) { return 1e-6 * m.at("sent_bytes").get<double>(); });
  row("device memory [MiB]",
      [](const Json& m) { return m.at("device_peak_bytes").get<double>() / (1 << 20); });
  return text + '\n';
}

}  // namespace ubs::bench
