// SPDX-License-Identifier: Apache-2.0
// join_job() connects the processes of a job that mpirun or srun has started. mpi.cpp is the only file that
// uses MPI. A build without MPI (UBS_MPI=OFF) contains without_mpi.cpp instead.
#pragma once

#include <cstddef>
#include <memory>

#include "host/cluster/communicator.hpp"

namespace ubs {

struct JobLimits {
  // If another rank does not answer for this time [s], the job ends. UBS_RANK_PATIENCE replaces the value.
  double patience = 600;
  // Maximum size of a message [bytes]. MPI stores sizes as int.
  std::size_t message = std::size_t{1} << 30;
};

// Returns the number of processes that the launcher (mpirun or srun) has started. Returns 1 if this process
// was not started by a launcher, and 0 if the launcher does not report the number.
int launched_ranks();

// Connects this process to the other processes of its job. Returns null if the process was not started by a
// launcher, or if the launcher has started only this process. Child processes of this process do not belong
// to the job. Throws Error(usage) if this build has no MPI, and a launcher has started several processes or
// does not report their number.
std::unique_ptr<Communicator> join_job(JobLimits limits = {});
// Ends all processes of the job with this exit code. Ranks that cannot continue call it. join_job() must have
// been called before.
[[noreturn]] void end_job(int code);

}  // namespace ubs
