// SPDX-License-Identifier: Apache-2.0
// Connects the processes of a job that mpirun or srun started. mpi.cpp is the only file that uses MPI; in a
// build without it (UBS_MPI=OFF), without_mpi.cpp replaces it.
#pragma once

#include <cstddef>
#include <memory>

#include "host/cluster/communicator.hpp"

namespace ubs {

struct JobLimits {
  double patience = 600;  // the job ends after this time without an answer [s]; UBS_RANK_PATIENCE
  std::size_t message = std::size_t{1} << 30;  // maximum bytes per message; MPI counts in int
};

// Returns the number of processes that the launcher started: 1 without a launcher, 0 if the launcher does not
// report the number.
int launched_ranks();

// Returns null if the process was not started by a launcher. Processes that this one starts do not belong to
// the job. Throws Error(usage) if a launcher started several processes and this build has no MPI.
std::unique_ptr<Communicator> join_job(JobLimits limits = {});
// Ends all processes of the job, if this rank cannot continue. Requires join_job().
[[noreturn]] void end_job(int code);

}  // namespace ubs
