// SPDX-License-Identifier: Apache-2.0
#include <cstdlib>

#include "host/cluster/mpi.hpp"

namespace ubs {

// mpirun of Open MPI sets OMPI_COMM_WORLD_SIZE. mpirun of MPICH, and Slurm with pmi2, set PMI_SIZE. Slurm
// with pmix only sets the rank, so the number of ranks is unknown, and the function returns 0.
int launched_ranks() {
  for (const char* name : {"OMPI_COMM_WORLD_SIZE", "PMI_SIZE"})
    if (const char* value = std::getenv(name)) return std::atoi(value);
  return std::getenv("PMIX_RANK") ? 0 : 1;
}

}  // namespace ubs
