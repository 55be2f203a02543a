// SPDX-License-Identifier: Apache-2.0
// Every call is one that does not block, and is asked about until it is done or patience ends: a rank that
// has died or is stuck ends the job and does not hang it.
#include "host/cluster/mpi.hpp"

#define OMPI_SKIP_MPICXX 1  // the C++ bindings, which MPI has given up
#define MPICH_SKIP_MPICXX 1
#include <mpi.h>

#include <algorithm>
#include <cstdlib>
#include <limits>
#include <thread>

#include "host/base/error.hpp"
#include "host/base/stopwatch.hpp"

namespace ubs {
namespace {

void check_mpi(int code, const char* call) {
  if (code == MPI_SUCCESS) return;
  char text[MPI_MAX_ERROR_STRING] = {};
  int length = 0;
  MPI_Error_string(code, text, &length);
  fail(ErrorKind::device, "{}: {}; the job cannot go on", call, text);
}

class MpiRanks final : public Communicator {
 public:
  explicit MpiRanks(const JobLimits& limits) : limits_(limits) {
    MPI_Comm_set_errhandler(MPI_COMM_WORLD, MPI_ERRORS_RETURN);
    MPI_Comm_rank(MPI_COMM_WORLD, &rank_);
    MPI_Comm_size(MPI_COMM_WORLD, &size_);
  }
  ~MpiRanks() override { MPI_Finalize(); }

  int rank() const override { return rank_; }
  int size() const override { return size_; }

  void be_patient() override { limits_.patience = std::numeric_limits<double>::infinity(); }

  std::vector<Bytes> exchange(const Pieces& pieces) override {
    const auto ranks = static_cast<std::size_t>(size_);
    if (pieces.size() != ranks) fail(ErrorKind::internal, "{} pieces for {} ranks", pieces.size(), size_);
    std::vector<std::uint64_t> out(ranks), in(ranks);
    std::ranges::transform(pieces, out.begin(), [](const auto& piece) { return piece.size(); });
    std::vector<MPI_Request> requests(1);
    check_mpi(MPI_Ialltoall(out.data(), 1, MPI_UINT64_T, in.data(), 1, MPI_UINT64_T, MPI_COMM_WORLD,
                            requests.data()),
              "MPI_Ialltoall");
    wait(requests);
    std::vector<Bytes> come(ranks);
    for (int r = 0; r < size_; ++r) {
      Bytes& to = come[static_cast<std::size_t>(r)];
      to.resize(in[static_cast<std::size_t>(r)]);
      if (r != rank_)
        for_parts(to.size(), [&](std::size_t at, int count) {
          check_mpi(
              MPI_Irecv(to.data() + at, count, MPI_BYTE, r, kTag, MPI_COMM_WORLD, &requests.emplace_back()),
              "MPI_Irecv");
        });
    }
    for (int step = 1; step < size_; ++step) {  // not all to the same rank at first
      const int r = (rank_ + step) % size_;
      const std::span<const std::byte> from = pieces[static_cast<std::size_t>(r)];
      for_parts(from.size(), [&](std::size_t at, int count) {
        check_mpi(
            MPI_Isend(from.data() + at, count, MPI_BYTE, r, kTag, MPI_COMM_WORLD, &requests.emplace_back()),
            "MPI_Isend");
      });
    }
    const auto own = static_cast<std::size_t>(rank_);
    std::ranges::copy(pieces[own], come[own].begin());
    wait(requests);
    return come;
  }

  void sum(std::span<std::uint64_t> values) override {
    constexpr std::size_t kMost = std::size_t{1} << 24;
    for (; !values.empty(); values = values.subspan(std::min(values.size(), kMost))) {
      std::vector<MPI_Request> request(1);
      check_mpi(MPI_Iallreduce(MPI_IN_PLACE, values.data(), static_cast<int>(std::min(values.size(), kMost)),
                               MPI_UINT64_T, MPI_SUM, MPI_COMM_WORLD, request.data()),
                "MPI_Iallreduce");
      wait(request);
    }
  }

 private:
  static constexpr int kTag = 1;

  template <typename Part>
  void for_parts(std::size_t bytes, const Part& part) const {
    for (std::size_t at = 0; at < bytes; at += limits_.message)
      part(at, static_cast<int>(std::min(limits_.message, bytes - at)));
  }

  // Ranks may be more than cores: after the first moments it leaves the core to others.
  void wait(std::vector<MPI_Request>& requests) const {
    constexpr double kBusy = 100e-6;
    const auto start = Clock::now();
    for (;;) {
      int done = 0;
      check_mpi(MPI_Testall(static_cast<int>(requests.size()), requests.data(), &done, MPI_STATUSES_IGNORE),
                "MPI_Testall");
      if (done) return requests.clear();
      const double waited = seconds_since(start);
      if (waited > limits_.patience)
        fail(
            ErrorKind::device,
            "no answer from the other ranks for {:.0f} s: one has died or is stuck (UBS_RANK_PATIENCE); `ubs "
            "train --resume` goes on from the last checkpoint",
            waited);
      if (waited > kBusy) std::this_thread::sleep_for(std::chrono::microseconds(20));
    }
  }

  JobLimits limits_;
  int rank_ = 0, size_ = 1;
};

}  // namespace

std::unique_ptr<Communicator> join_job(JobLimits limits) {
  if (launched_ranks() == 1) return nullptr;
  if (const char* text = std::getenv("UBS_RANK_PATIENCE")) {
    char* end = nullptr;
    limits.patience = std::strtod(text, &end);
    if (end == text || *end != '\0' || !(limits.patience > 0))
      fail(ErrorKind::usage, "UBS_RANK_PATIENCE '{}' is not a number of seconds above 0", text);
  }
  int provided = 0;
  check_mpi(MPI_Init_thread(nullptr, nullptr, MPI_THREAD_FUNNELED, &provided), "MPI_Init_thread");
  for (const char* name : {"OMPI_COMM_WORLD_SIZE", "PMI_SIZE", "PMIX_RANK"}) unsetenv(name);
  return std::make_unique<MpiRanks>(limits);
}

void end_job(int code) {
  MPI_Abort(MPI_COMM_WORLD, code);
  std::_Exit(code);
}

}  // namespace ubs
