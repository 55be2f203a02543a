// SPDX-License-Identifier: Apache-2.0
// The job that this process is a rank of, where mpirun or srun started it (docs/cluster.md). The first rank
// prints and writes; the others are silent but for their errors.
#pragma once

#include <string>

#include "host/cluster/communicator.hpp"

namespace ubs::tools {

void join();  // before anything else is done; throws Error
void leave();
// alone() where the process was started by itself.
Communicator& ranks();

// Whether it is so on any rank. All ranks ask.
bool on_any_rank(bool here);

// "rank 2: " in front of an error, "" on the first rank. Other ranks wait a moment first: an error that all
// find is told by the first one, whose end ends them.
std::string error_prefix();
// Ends the job; returns `code` where there is none.
int end_with_error(int code);

// What --device says for this rank: of a list with commas one after the other by the ranks of a machine;
// where nothing is said the cards of the machine likewise.
std::string device_of_rank(const std::string& request);

}  // namespace ubs::tools
