// SPDX-License-Identifier: Apache-2.0
#include <cstdlib>

#include "host/cluster/mpi.hpp"

namespace ubs {

// Open MPI's mpirun sets the first variable. MPICH's mpirun, and Slurm with pmi2, set the second one. Slurm
// with pmix only reports the rank.
int launched_ranks() {
  for (const char* name : {"OMPI_COMM_WORLD_SIZE", "PMI_SIZE"})
    if (const char* value = std::getenv(name)) return std::atoi(value);
  return std::getenv("PMIX_RANK") ? 0 : 1;
}

}  // namespace ubs
