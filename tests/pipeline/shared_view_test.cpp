// SPDX-License-Identifier: Apache-2.0
// Tests views that ranks render together (SharedRenderer): each rank has a part of the splats. The ranks are
// simulated in one process, on every device. Images and gradients must be bit-identical to those of a
// renderer with all splats, whether or not ranks can directly access the memory of each other's GPUs.
#include <catch2/catch.hpp>
#include <cstring>

#include "host/cluster/share.hpp"
#include "host/device/operations.hpp"
#include "host/lab/bench/bench_scene.hpp"
#include "host/pipeline/device_model.hpp"
#include "host/pipeline/shared_renderer.hpp"
#include "tests/support/device_fixture.hpp"

namespace ubs {
namespace {

// Stores the messages between simulated ranks, which run in a single thread. Desk is the communicator of one
// rank, and Mail is an exchange of messages between all ranks.
class Office {
 public:
  Office(int ranks, bool takes_cards) : takes_cards_(takes_cards), sent_(static_cast<std::size_t>(ranks)) {}

  class Desk final : public Communicator {
   public:
    Desk(Office& office, int rank) : office_(office), rank_(rank) {}
    int rank() const override { return rank_; }
    int size() const override { return static_cast<int>(office_.sent_.size()); }
    bool takes_memory(MemoryKind kind) const override {
      return kind == MemoryKind::host || office_.takes_cards_;
    }
    void sum(std::span<std::uint64_t>) override {}
    std::unique_ptr<Exchange> start(const Pieces& pieces) override {
      auto& sent = office_.sent_[static_cast<std::size_t>(rank_)];
      sent.push_back(pieces);
      return std::make_unique<Mail>(office_, static_cast<std::size_t>(rank_), sent.size() - 1);
    }

   private:
    Office& office_;
    int rank_;
  };

 private:
  struct Mail final : Exchange {
    Mail(Office& office, std::size_t rank, std::size_t number) : office(office), rank(rank), number(number) {}
    const std::vector<std::uint64_t>& sizes() override {
      come.clear();
      for (const auto& sent : office.sent_) come.push_back(sent.at(number).at(rank).size());
      return come;
    }
    void receive(std::span<std::byte* const> into) override {
      for (std::size_t r = 0; r < into.size(); ++r) {
        const auto piece = office.sent_[r].at(number).at(rank);
        if (!piece.empty()) std::memcpy(into[r], piece.data(), piece.size());
      }
    }
    Office& office;
    std::size_t rank, number;
    std::vector<std::uint64_t> come;
  };

  bool takes_cards_;
  std::vector<std::vector<Pieces>> sent_;
};

SplatModel part(const SplatModel& model, const Share& share) {
  SplatModel out(model.dim, share.count, model.variant);
  for (int r = 0; r < model.layout().count; ++r) {
    const auto from = model.row(r).subspan(share.first, share.count);
    std::ranges::copy(from, out.row(r).begin());
  }
  return out;
}

// Copies the image to the buffer for its gradient. This is the gradient of half the sum of the squared
// colours.
void differentiate(Device& device, Renderer& renderer) {
  const BufferView<float> image = renderer.image(), v_image = renderer.v_image();
  device.copy(*image.memory, 0, *v_image.memory, 0, image.size * sizeof(float));
}

struct Rank {
  Rank(Device& device, Office& office, int number, const bench::BenchScene& scene, int ranks)
      : desk(office, number),
        stages(make_stages(device, {.dim = scene.model.dim, .raster = RasterKind::gpu})),
        model(device,
              part(scene.model, share_of(static_cast<std::uint32_t>(scene.model.count), ranks, number)),
              scene.model.count),
        drawer(device, *stages),
        shared(desk, device, *stages, drawer),
        v_params(device, "gradient", static_cast<std::size_t>(model.rows()) * model.stride()) {
    drawer.set_cameras(cameras_of(scene.views));
    shared.set_cameras(cameras_of(scene.views));
    v_params.zero();
  }
  Office::Desk desk;
  std::unique_ptr<Stages> stages;
  DeviceModel model;
  Renderer drawer;
  SharedRenderer shared;
  Buffer<float> v_params;
};

TEST_CASE("views that ranks render together are bit-identical to those of one process", "[ranks]") {
  constexpr int kRanks = 3;
  const bench::BenchScene scene = bench::random_start(6, 300, 64, 64);
  REQUIRE(scene.views.views.size() >= 4);
  for (const auto& device : test::devices_under_test())
    for (const bool takes_cards : {false, true}) {
      INFO(describe(device->info()) << (takes_cards ? ", ranks access GPU memory" : ""));
      // The ranks of this test copy memory with memcpy, which cannot read the memory of a real GPU.
      if (takes_cards && device->info().backend == "cuda" && !test::on_host(*device)) {
        WARN(device->info().name << ": skipped: this test cannot simulate ranks that access GPU memory");
        continue;
      }
      const auto stages = make_stages(*device, {.dim = 6, .raster = RasterKind::gpu});
      const DeviceModel all(*device, scene.model, scene.model.count);
      Renderer renderer(*device, *stages);
      renderer.set_cameras(cameras_of(scene.views));
      const Buffer<float> v_all(*device, "gradient", static_cast<std::size_t>(all.rows()) * all.stride());

      Office office(kRanks, takes_cards);
      std::vector<std::unique_ptr<Rank>> ranks;
      for (int r = 0; r < kRanks; ++r)
        ranks.push_back(std::make_unique<Rank>(*device, office, r, scene, kRanks));
      // There are four views in two rounds. In the second round, only the first rank renders a view. The
      // records of the second round are sent while the views of the first round are rendered.
      const std::vector<std::vector<std::int64_t>> deal{{0, 1, 2}, {3, kNoView, kNoView}};
      std::vector<std::array<SharedRenderer::Round, 2>> rounds(kRanks);
      const auto begin = [&](std::size_t round) {
        for (std::size_t r = 0; r < kRanks; ++r)
          rounds[r][round] = ranks[r]->shared.begin(ranks[r]->model.view(), deal[round], {});
      };
      const auto add = [&](std::size_t round) {
        for (std::size_t r = 0; r < kRanks; ++r) {
          ranks[r]->shared.receive_gradients(rounds[r][round]);
          const BufferView<float> v_params = ranks[r]->v_params.view();
          for (std::size_t other = 0; other < kRanks; ++other)
            if (deal[round][other] != kNoView)
              ranks[r]
                  ->shared.gradient_of(rounds[r][round], other)
                  .backward_from_records(std::span(&v_params, 1), true);
        }
      };
      begin(0);
      for (std::size_t round = 0; round < 2; ++round) {
        if (round == 0) begin(1);
        for (std::size_t r = 0; r < kRanks; ++r) {
          Rank& rank = *ranks[r];
          const auto totals = rank.shared.forward(rounds[r][round], true);
          REQUIRE(totals.has_value() == (deal[round][r] != kNoView));
          if (totals) {
            const auto view = static_cast<std::uint32_t>(deal[round][r]);
            const ListTotals expected = renderer.forward(all.view(), view, {}, true);
            CHECK(totals->visible == expected.visible);
            CHECK(totals->intersections == expected.intersections);
            CHECK((rank.drawer.download().rgb == renderer.download().rgb));
            differentiate(*device, rank.drawer);
            rank.drawer.backward_to_records();
          }
          rank.shared.send_gradients(rounds[r][round]);
        }
        add(round);
      }
      for (std::uint32_t view = 0; view < 4; ++view) {
        renderer.forward(all.view(), view, {}, true);
        differentiate(*device, renderer);
        renderer.backward(v_all.view(), view > 0);
      }
      const std::vector<float> expected = v_all.download();
      std::size_t wrong = 0, compared = 0;
      for (int r = 0; r < kRanks; ++r) {
        const Share share = share_of(300, kRanks, r);
        const std::vector<float> own = ranks[static_cast<std::size_t>(r)]->v_params.download();
        const std::size_t stride = ranks[static_cast<std::size_t>(r)]->model.stride();
        for (std::size_t row = 0; row < static_cast<std::size_t>(all.rows()); ++row)
          for (std::size_t i = 0; i < share.count; ++i, ++compared)
            wrong += own[row * stride + i] != expected[row * all.stride() + share.first + i];
      }
      CHECK(compared == 300 * static_cast<std::size_t>(all.rows()));
      CHECK(wrong == 0);
      CHECK(ranks[0]->shared.bytes_sent() > 0);
    }
}

}  // namespace
}  // namespace ubs
