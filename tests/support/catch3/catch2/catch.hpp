// SPDX-License-Identifier: Apache-2.0
// Catch2 3 under the names of Catch2 2, which tests use: Debian 12 has the one, Debian 13 the other.
#pragma once

#include <catch2/catch_all.hpp>
#include <string>

namespace Catch {

namespace clara = Clara;
using Matchers::StartsWith;
inline auto Contains(const std::string& text) { return Matchers::ContainsSubstring(text); }

}  // namespace Catch

using Catch::Approx;
