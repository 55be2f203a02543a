// SPDX-License-Identifier: Apache-2.0
// This header provides Catch2 3 under the names of Catch2 2, which the tests use. Debian 12 has Catch2 2, and
// Debian 13 has Catch2 3.
#pragma once

#include <catch2/catch_all.hpp>
#include <string>

namespace Catch {

namespace clara = Clara;
using Matchers::StartsWith;
inline auto Contains(const std::string& text) { return Matchers::ContainsSubstring(text); }

}  // namespace Catch

using Catch::Approx;
