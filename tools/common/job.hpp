// SPDX-License-Identifier: Apache-2.0
// These functions join and leave the MPI job of which this process is a rank, if mpirun or srun started it
// (docs/cluster.md). Only the first rank prints and writes; the others only print errors.
#pragma once

#include <string>

#include "host/cluster/communicator.hpp"

namespace ubs::tools {

void join();  // must be called first; throws Error
void leave();
// Returns alone() if the process was not started as part of a job.
Communicator& ranks();

// Returns whether `here` is true on any rank. Must be called by all ranks.
bool on_any_rank(bool here);

// Returns the prefix of an error message: "rank 2: ", or "" on the first rank. Other ranks wait a moment
// before they return. So if all ranks find the same error, only the first one reports it, because its exit
// ends the others.
std::string error_prefix();
// Ends the job. Returns `code` if there is no job.
int end_with_error(int code);

// Returns the device for this rank. If --device is a list with commas, the ranks of a machine take its
// entries in turn. If it is empty, they take the GPUs of the machine in turn.
std::string device_of_rank(const std::string& request);

}  // namespace ubs::tools
