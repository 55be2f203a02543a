// SPDX-License-Identifier: Apache-2.0
// The ranks of a job that mpirun or srun started. The only file that knows MPI is mpi.cpp; in a build without
// it (UBS_MPI=OFF) its place is taken by without_mpi.cpp.
#pragma once

#include <cstddef>
#include <memory>

#include "host/cluster/communicator.hpp"

namespace ubs {

struct JobLimits {
  double patience = 600;  // seconds without an answer after which the job ends; UBS_RANK_PATIENCE
  std::size_t message = std::size_t{1} << 30;  // bytes of one message: MPI counts in int
};

// What the launcher says: how many processes it started, 1 where there is none, 0 where it does not say.
int launched_ranks();

// Null where the process was started by itself. Processes that this one starts are no part of the job. Throws
// Error(usage) where a launcher started several and this build has no MPI.
std::unique_ptr<Communicator> join_job(JobLimits limits = {});
// Ends all processes of the job: for a rank that cannot go on. To be called after join_job().
[[noreturn]] void end_job(int code);

}  // namespace ubs
