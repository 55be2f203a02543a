// SPDX-License-Identifier: Apache-2.0
// All MPI operations in this file are non-blocking. They are polled until they complete or until a time limit
// is exceeded. Therefore a rank that has crashed or hangs ends the job instead of blocking it.
#include "host/cluster/mpi.hpp"

#define OMPI_SKIP_MPICXX 1  // excludes the obsolete C++ bindings of MPI
#define MPICH_SKIP_MPICXX 1
#include <mpi.h>
#if defined(OPEN_MPI)
#include <mpi-ext.h>
#endif

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
  fail(ErrorKind::device, "{}: {}; the job cannot continue", call, text);
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

  bool takes_memory(MemoryKind kind) const override {
    if (kind != MemoryKind::cuda) return Communicator::takes_memory(kind);
    int takes = 0;
#if defined(MPIX_CUDA_AWARE_SUPPORT)  // Open MPI
    takes = MPIX_Query_cuda_support();
#elif defined(MPIX_GPU_SUPPORT_CUDA)  // MPICH
    MPIX_GPU_query_support(MPIX_GPU_SUPPORT_CUDA, &takes);
#endif
    return takes != 0;
  }

  std::unique_ptr<Exchange> start(const Pieces& pieces) override {
    if (pieces.size() != static_cast<std::size_t>(size_))
      fail(ErrorKind::internal, "the number of messages is {}, but there are {} ranks", pieces.size(), size_);
    number_ = number_ % kNumbers + 1;
    return std::make_unique<OnTheWay>(*this, pieces, number_);
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
  static constexpr int kNumbers = 32767;  // largest tag (message number) that every MPI library supports

  // OnTheWay is an exchange that has started. The sizes of the pieces are sent first, then the pieces. All
  // ranks start exchanges in the same order, so the number of an exchange identifies it on all ranks, even if
  // several exchanges are pending.
  class OnTheWay final : public Exchange {
   public:
    OnTheWay(const MpiRanks& ranks, const Pieces& pieces, int number)
        : ranks_(ranks),
          number_(number),
          out_(pieces.size()),
          in_(pieces.size()),
          own_(pieces[static_cast<std::size_t>(ranks.rank_)]) {
      std::ranges::transform(pieces, out_.begin(), [](const auto& piece) { return piece.size(); });
      check_mpi(MPI_Ialltoall(out_.data(), 1, MPI_UINT64_T, in_.data(), 1, MPI_UINT64_T, MPI_COMM_WORLD,
                              &sizes_.emplace_back()),
                "MPI_Ialltoall");
      for (int step = 1; step < ranks.size_; ++step) {  // each rank starts with a different receiver
        const int r = (ranks.rank_ + step) % ranks.size_;
        const std::span<const std::byte> from = pieces[static_cast<std::size_t>(r)];
        ranks.for_parts(from.size(), [&](std::size_t at, int count) {
          check_mpi(MPI_Isend(from.data() + at, count, MPI_BYTE, r, number, MPI_COMM_WORLD,
                              &pieces_.emplace_back()),
                    "MPI_Isend");
        });
      }
    }

    const std::vector<std::uint64_t>& sizes() override {
      ranks_.wait(sizes_);
      return in_;
    }

    void receive(std::span<std::byte* const> into) override {
      sizes();
      for (int r = 0; r < ranks_.size_; ++r) {
        std::byte* const to = into[static_cast<std::size_t>(r)];
        if (r == ranks_.rank_) {
          std::ranges::copy(own_, to);
          continue;
        }
        ranks_.for_parts(in_[static_cast<std::size_t>(r)], [&](std::size_t at, int count) {
          check_mpi(MPI_Irecv(to + at, count, MPI_BYTE, r, number_, MPI_COMM_WORLD, &pieces_.emplace_back()),
                    "MPI_Irecv");
        });
      }
      ranks_.wait(pieces_);
    }

   private:
    const MpiRanks& ranks_;
    int number_;
    std::vector<std::uint64_t> out_, in_;
    std::span<const std::byte> own_;
    std::vector<MPI_Request> sizes_, pieces_;
  };

  // Divides `bytes` bytes into messages, and calls part(offset, size) for each message.
  template <typename Part>
  void for_parts(std::size_t bytes, const Part& part) const {
    for (std::size_t at = 0; at < bytes; at += limits_.message)
      part(at, static_cast<int>(std::min(limits_.message, bytes - at)));
  }

  // Waits until all requests have completed. Other ranks and the threads of a device may use the same cores.
  // Therefore this function polls without a pause only for a short time, and then sleeps between polls. The
  // longer it has waited, the longer it sleeps, up to 1 ms.
  void wait(std::vector<MPI_Request>& requests) const {
    constexpr double kBusy = 100e-6;
    const Stopwatch watch;
    for (;;) {
      int done = 0;
      check_mpi(MPI_Testall(static_cast<int>(requests.size()), requests.data(), &done, MPI_STATUSES_IGNORE),
                "MPI_Testall");
      if (done) return requests.clear();
      const double waited = watch.seconds();
      if (waited > limits_.patience)
        fail(ErrorKind::device,
             "no answer from the other ranks for {:.0f} s (UBS_RANK_PATIENCE sets this limit): one of them "
             "has "
             "crashed or hangs; resume from the last checkpoint with 'ubs train --resume'",
             waited);
      if (waited > kBusy)
        std::this_thread::sleep_for(std::chrono::duration<double>(std::clamp(waited / 64, 20e-6, 1e-3)));
    }
  }

  JobLimits limits_;
  int rank_ = 0, size_ = 1, number_ = 0;
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
