// SPDX-License-Identifier: Apache-2.0
// This file tests the command `ubs-lab stress`: its output, exit codes and options.
#include <catch2/catch.hpp>

#include "host/base/error.hpp"
#include "tests/support/run_ubs.hpp"

namespace ubs {
namespace {

using Catch::Contains;
using test::Result;
using test::TempFolder;

Result run_stress(const TempFolder& folder, const std::string& arguments) {
  return test::run_ubs(folder, "stress " + arguments);
}

TEST_CASE("stress: the report contains the names of the tests and the outcomes of cases", "[cli][stress]") {
  const TempFolder folder;
  const Result result =
      run_stress(folder, "--device opencl --seed 5 --cases 20 'near plane*,random cases' -r junit -o r.xml");
  INFO(result.err);
  CHECK(result.code == 0);
  CHECK_THAT(test::get(folder / "r.xml"), Contains("<testcase ") && Contains("near plane") &&
                                              Contains(" 45 float64,") && Contains("random cases"));
}

TEST_CASE("stress: a failing random case gives exit code 9 and the command to repeat it", "[cli][stress]") {
  const TempFolder folder;
  const Result result =
      run_stress(folder, "--device opencl --seed 7 --first 30 --cases 2 'random cases on a faulty device'");
  CHECK(result.code == 9);
  CHECK_THAT(result.out, Contains("the image is not finite") &&
                             Contains("ubs-lab stress 'random cases' --seed 7 --first 31 --cases 1"));
}

TEST_CASE("stress: test cases are listed, and wrong options are rejected", "[cli][stress]") {
  const TempFolder folder;
  const Result list = run_stress(folder, "--list-tests '[stage]'");
  CHECK(list.code == 0);
  CHECK_THAT(list.out, Contains("loss: ") && !Contains("needles"));
  const Result help = run_stress(folder, "--help");
  CHECK(help.code == 0);
  CHECK_THAT(help.out, Contains("--device") && Contains("--cases"));
  for (const auto& [arguments, part] : {std::pair{"nothing_of_the_kind", "--list-tests"},
                                        {"--cases -5", "--cases"},
                                        {"--first -1", "--first"},
                                        {"--seed -1", "--seed"},
                                        {"--cases many", "many"},
                                        {"--raster fast", "raster"},
                                        {"--no-such-option", "no-such-option"}}) {
    const Result result = run_stress(folder, arguments);
    INFO(arguments << "\n" << result.err);
    CHECK(result.code == 2);
    CHECK_THAT(result.err, Contains(part));
  }
}

}  // namespace
}  // namespace ubs
