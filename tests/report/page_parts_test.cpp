// SPDX-License-Identifier: Apache-2.0
// Tests the parts from which pages of `ubs report` are built: escaping, data in script elements, histograms,
// and images as data URIs.
#include <cmath>
#include <limits>
#include <numeric>
#include <opencv2/imgcodecs.hpp>

#include "host/look/report/histogram.hpp"
#include "host/look/report/html.hpp"
#include "host/look/report/page_picture.hpp"
#include "host/look/report/report_page.hpp"
#include "tests/support/html_check.hpp"
#include "tests/support/images.hpp"

using namespace ubs;
using namespace ubs::test;
using Catch::Contains;

namespace {

const double kNan = std::numeric_limits<double>::quiet_NaN();

cv::Mat decoded(const std::string& uri) {
  return cv::imdecode(data_uri_bytes(uri, {"image/png", "image/jpeg"}), cv::IMREAD_COLOR);
}

}  // namespace

TEST_CASE("html: text is escaped, and the checker of pages detects errors", "[report]") {
  CHECK(escape_html("<a href=\"x\">'&amp;'</a>") ==
        "&lt;a href=&quot;x&quot;&gt;&#39;&amp;amp;&#39;&lt;/a&gt;");
  CHECK(escape_html("gr\xc3\xbc\xc3\x9f \xf0\x9f\x8e\x89\t\n") == "gr\xc3\xbc\xc3\x9f \xf0\x9f\x8e\x89\t\n");
  CHECK(escape_html("a\xff"
                    "b\x01\x7f") == "a\\xffb\\x01\\x7f");
  CHECK(escape_html("\xc3") == "\\xc3");                    // a truncated sequence
  CHECK(escape_html("\xc0\xbc") == "\\xc0\\xbc");           // an overlong encoding of '<'
  CHECK(escape_html("\xed\xa0\x80") == "\\xed\\xa0\\x80");  // an encoded surrogate
  CHECK(escape_html("\xf4\x90\x80\x80") == "\\xf4\\x90\\x80\\x80");

  for (const char* wrong :
       {"<p>", "</p>", "<p><b></p></b>", "<p a=b></p>", "a & b", "<p a=\"1\" a=\"2\"></p>", "x > y"})
    CHECK_FALSE(check_html(wrong).error.empty());
}

TEST_CASE("html: markup in the title or the data of a page is not interpreted", "[report]") {
  const std::string title = "</title><script>alert(1)</script>&",
                    data = "</script><!--<script>\xe2\x80\xa8\"'&";
  const std::string body = "<script id=\"data\" type=\"application/json\">" +
                           script_json(Json::object({{data, data}})) + "</script>";
  const std::string page = page_shell(title, {{"p{}", "00ff"}}, {}, "img-src data:", body);
  const HtmlCheck check = check_html(page);
  CHECK(check.error.empty());
  CHECK(check.all("script").size() == 1);
  CHECK(check.all("title").size() == 1);
  CHECK_THAT(page, Contains("&lt;/title&gt;&lt;script&gt;") && Contains("style-src &#39;sha256-AP8=&#39;"));
  const std::size_t begin = page.find("json\">") + 6;
  CHECK(parse_own_json(page.substr(begin, page.find("</script>") - begin), "data") ==
        Json::object({{data, data}}));
}

TEST_CASE("report page: the script contains the licence of Chart.js and does not create elements from text",
          "[report]") {
  const std::string style = report_style().text, script = report_script().text;
  for (const std::string& text : {style, script}) CHECK_THAT(text, !Contains("</"));
  CHECK_THAT(script, Contains("Copyright (c) 2014-2022 Chart.js Contributors") &&
                         Contains("permission notice shall be included") && Contains("window.Chart="));
  for (const char* name : {"innerHTML", "outerHTML", "insertAdjacentHTML", "document.write", "eval("})
    CHECK_THAT(script, !Contains(name));
}

TEST_CASE("histogram: computes edges and shares, and counts values outside the edges", "[report]") {
  const Bins bins = make_bins(0.0, 1.0, 4);
  CHECK(bins.edges == std::vector<double>{0, 0.25, 0.5, 0.75, 1});
  const std::vector<double> values{0, 0.2, 0.25, 0.5, 1, -1, 7, kNan, 0.3, 0.3};
  const Histogram h = make_histogram(values, bins);
  CHECK(h.values == 9);
  CHECK(h.below == 1);
  CHECK(h.above == 1);
  const std::vector<double> counts{2, 3, 1, 1};
  for (std::size_t i = 0; i < 4; ++i) CHECK(h.share[i] == Approx(counts[i] / 9));
  CHECK(h.minimum == -1);
  CHECK(h.median == 0.3);
  CHECK(h.maximum == 7);
  CHECK(make_histogram({}, bins).values == 0);

  std::vector<double> many(1000);
  std::iota(many.begin(), many.end(), 1.0);
  const Bins bulk = make_bins(many, 10, false, 0.01);
  CHECK(bulk.edges.front() == 11);
  CHECK(bulk.edges.back() == 990);
  CHECK(make_histogram(many, bulk).below == 10);
  const Bins logarithmic = make_bins({-3, 0, kNan, 1, 10, 100}, 2, true, 0);
  REQUIRE(logarithmic.edges.size() == 3);
  CHECK(logarithmic.edges[1] == Approx(10));
  CHECK(make_histogram(std::vector<double>{-3, 0, 1, 100}, logarithmic).below == 2);
  for (const bool log : {false, true})
    for (const std::vector<double>& narrow :
         {std::vector<double>{}, {0.0}, {3, 3, 3}, {1, 1 + 1e-9}, {-2.0}}) {
      const Bins b = make_bins(narrow, 8, log, 0.01);
      CHECK(std::is_sorted(b.edges.begin(), b.edges.end()));
      CHECK(b.edges.back() > b.edges.front());
      const std::vector<double> share = make_histogram(narrow, b).share;
      if (!narrow.empty() && (narrow[0] > 0 || !log))
        CHECK(std::accumulate(share.begin(), share.end(), 0.0) == Approx(1));
    }
}

TEST_CASE("page image: data URIs contain the pixels", "[report]") {
  const auto encoded = [](const std::string& text) {
    return base64({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
  };
  for (const auto& [plain, code] : {std::pair{"", ""},
                                    {"f", "Zg=="},
                                    {"fo", "Zm8="},
                                    {"foo", "Zm9v"},
                                    {"foob", "Zm9vYg=="},
                                    {"fooba", "Zm9vYmE="},
                                    {"foobar", "Zm9vYmFy"}})  // the examples of RFC 4648
    CHECK(encoded(plain) == code);

  const Image8 small = gradient_image(31, 17);
  const std::string exact = page_picture(small, 100);
  CHECK(exact.starts_with("data:image/png;base64,"));
  const cv::Mat pixels = decoded(exact);
  REQUIRE((pixels.cols == 31 && pixels.rows == 17));
  const cv::Vec3b bgr = pixels.at<cv::Vec3b>(5, 7);
  for (std::size_t c = 0; c < 3; ++c) CHECK(bgr[2 - static_cast<int>(c)] == small.rgb[3 * (5 * 31 + 7) + c]);

  Image8 noise = gradient_image(400, 200);
  for (std::size_t i = 0; i < noise.rgb.size(); ++i)
    noise.rgb[i] = static_cast<std::uint8_t>(i * i * 2654435761u >> 13);
  const std::string photograph = page_picture(noise, 300);
  CHECK(photograph.starts_with("data:image/jpeg;base64,"));
  CHECK((decoded(photograph).cols == 300 && decoded(photograph).rows == 150));
}

TEST_CASE("page image: images of errors, depths and alpha, and the PSNR, have the expected values",
          "[report]") {
  const auto flat = [](std::uint8_t v) { return Image8{2, 1, {v, v, v, v, v, v}}; };
  const auto sum = [](const Image8& image, std::size_t pixel) {
    return image.rgb[3 * pixel] + image.rgb[3 * pixel + 1] + image.rgb[3 * pixel + 2];
  };
  const int none = sum(error_image(flat(10), flat(10), 0.25), 0),
            some = sum(error_image(flat(10), flat(40), 0.25), 0),
            most = sum(error_image(flat(0), flat(255), 0.25), 0);
  CHECK(none < 10);
  CHECK(none < some);
  CHECK(some < most);
  CHECK(error_image(flat(0), flat(64), 0.25).rgb == error_image(flat(0), flat(255), 0.25).rgb);
  CHECK_THAT(message_of(
                 [&] {
                   error_image(flat(1), Image8{1, 1, {1, 2, 3}}, 1);
                 },
                 ErrorKind::internal),
             Contains("2 x 1"));

  const std::vector<float> depth{2, 6, 100, 4}, alpha{1, 0.9f, 0.1f, 1};
  const ValueRange range = central_depth_range(depth, alpha);
  CHECK(range.low == 2);
  CHECK(range.high == 6);  // the nearly transparent pixel is ignored
  const Image8 picture = depth_image(depth, alpha, 4, 1, range);
  CHECK(sum(picture, 0) > sum(picture, 3));
  CHECK(sum(picture, 3) > sum(picture, 1));
  CHECK(central_depth_range(std::vector<float>{3, 3}, std::vector<float>{1, 1}).high > 3);
  CHECK(central_depth_range({}, {}).high == 1);
  CHECK(central_depth_range(std::vector<float>{3, 5}, std::vector<float>{0, 0}).high == 5);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  CHECK(grey_image(std::vector<float>{0, 0.5f, 2, nan}, 4, 1).rgb ==
        std::vector<std::uint8_t>{0, 0, 0, 128, 128, 128, 255, 255, 255, 0, 0, 0});

  // The mean squared errors of the channels are (1/255)^2, (2/255)^2 and (4/255)^2. The result is the mean of
  // the PSNRs of the channels, not the PSNR of the mean error.
  const double expected = 20 * std::log10(255.0) - 20 * std::log10(1.0 * 2 * 4) / 3;
  CHECK(psnr_channel_mean(Image8{1, 1, {10, 10, 10}}, Image8{1, 1, {11, 8, 14}}) == Approx(expected));
  CHECK(std::isinf(psnr_channel_mean(flat(3), flat(3))));
}

// With an earlier version, whose time was quadratic in the number of settings, this took many minutes.
TEST_CASE("report page: a run with very many unknown settings gives a page", "[report]") {
  constexpr std::size_t kMany = 300'000;
  ReportRun run;
  for (std::size_t i = 0; i < kMany; ++i)
    run.record.setting_texts.emplace_back(fmt::format("unknown{}", i), "1");
  const ReportPage page = make_report({run}, "ubs", {});
  CHECK(page.record["runs"][0]["settings"].size() == kMany);
}
