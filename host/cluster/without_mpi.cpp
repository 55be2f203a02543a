// SPDX-License-Identifier: Apache-2.0
#include <cstdlib>

#include "host/base/error.hpp"
#include "host/cluster/mpi.hpp"

namespace ubs {

std::unique_ptr<Communicator> join_job(JobLimits) {
  if (launched_ranks() != 1)
    fail(ErrorKind::usage,
         "started as one of several MPI processes, but this build has no MPI: build with UBS_MPI=ON "
         "(docs/cluster.md), or start it without mpirun");
  return nullptr;
}

void end_job(int code) { std::_Exit(code); }

}  // namespace ubs
