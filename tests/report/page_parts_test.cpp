// SPDX-License-Identifier: Apache-2.0
// Building blocks of pages: escaping and closing of HTML, charts, histograms, pictures as data URIs.
#include <cmath>
#include <limits>
#include <numeric>
#include <opencv2/imgcodecs.hpp>
#include <set>

#include "host/report/histogram.hpp"
#include "host/report/html.hpp"
#include "host/report/page_picture.hpp"
#include "host/report/report_sections.hpp"
#include "host/report/svg_chart.hpp"
#include "tests/support/html_check.hpp"
#include "tests/support/images.hpp"

using namespace ubs;
using namespace ubs::test;
using Catch::Contains;

namespace {

const double kNan = std::numeric_limits<double>::quiet_NaN(),
             kInfinity = std::numeric_limits<double>::infinity();

// Coordinates of all lines of a chart.
std::vector<std::pair<double, double>> line_points(const Html& chart) {
  std::vector<std::pair<double, double>> points;
  for (const HtmlElement& e : check_html(chart.markup).elements) {
    if (!e.at("class").starts_with("line")) continue;
    std::string path = e.at("d");
    for (char& c : path)
      if (c == 'M' || c == 'L') c = ' ';
    std::istringstream stream(path);
    for (double x, y; stream >> x >> y;) points.emplace_back(x, y);
  }
  return points;
}

std::size_t count_of(const Html& chart, const std::string& element) {
  return check_html(chart.markup).all(element).size();
}

cv::Mat decoded(const PagePicture& picture) {
  return cv::imdecode(data_uri_bytes(picture.uri, {"image/png", "image/jpeg"}), cv::IMREAD_COLOR);
}

}  // namespace

TEST_CASE("html: everything is escaped and closed", "[report]") {
  CHECK(escape_html("<a href=\"x\">'&amp;'</a>") ==
        "&lt;a href=&quot;x&quot;&gt;&#39;&amp;amp;&#39;&lt;/a&gt;");
  CHECK(escape_html("gr\xc3\xbc\xc3\x9f \xf0\x9f\x8e\x89\t\n") == "gr\xc3\xbc\xc3\x9f \xf0\x9f\x8e\x89\t\n");
  CHECK(escape_html("a\xff"
                    "b\x01\x7f") == "a\\xffb\\x01\\x7f");
  CHECK(escape_html("\xc3") == "\\xc3");                    // cut off
  CHECK(escape_html("\xc0\xbc") == "\\xc0\\xbc");           // an overlong <
  CHECK(escape_html("\xed\xa0\x80") == "\\xed\\xa0\\x80");  // a surrogate
  CHECK(escape_html("\xf4\x90\x80\x80") == "\\xf4\\x90\\x80\\x80");

  const Html nasty = tag("p", {{"class", "\"><script>"}}, text("</p>&<b>"));
  CHECK(nasty.markup == "<p class=\"&quot;&gt;&lt;script&gt;\">&lt;/p&gt;&amp;&lt;b&gt;</p>");
  CHECK(check_html(nasty.markup).error.empty());
  const Html grid = table({{text("a<b")}, {}}, {{{text("x")}, {text("&"), "number"}}, {}}, {"differ"});
  const HtmlCheck check = check_html(grid.markup + void_tag("img", {{"alt", "a\"b"}}).markup);
  CHECK(check.error.empty());
  CHECK(check.all("tr").size() == 3);
  CHECK(check.all("tr")[1].at("class") == "differ");
  CHECK(check.all("td").size() == 1);
  CHECK_THAT(message_of([] { tag("a b", {}); }, ErrorKind::internal), Contains("no name"));
  CHECK_THAT(message_of(
                 [] {
                   void_tag("img", {{"on click", ""}});
                 },
                 ErrorKind::internal),
             Contains("no name"));

  // The checker can fail.
  for (const char* wrong :
       {"<p>", "</p>", "<p><b></p></b>", "<p a=b></p>", "a & b", "<p a=\"1\" a=\"2\"></p>", "x > y"})
    CHECK_FALSE(check_html(wrong).error.empty());
  for (const std::string& asset : {report_style().text, report_script().text})
    CHECK(asset.find("</") == std::string::npos);
}

TEST_CASE("chart: lines lie in the frame and leave out what cannot be drawn", "[report]") {
  const ChartOptions options{.title = "a < b", .x_label = "x", .y_label = "y"};
  const Html chart =
      svg_chart(options, std::vector<ChartSeries>{{"s", {0, 1, kNan, 2, 4}, {1, kInfinity, 3, 2, 5}, 9}});
  CHECK(check_html(chart.markup).error.empty());
  const auto points = line_points(chart);
  REQUIRE(points.size() == 3);
  for (const auto& [x, y] : points) {
    CHECK((x > 0 && x < options.width));
    CHECK((y > 0 && y < options.height));
  }
  CHECK((points[0].first < points[1].first && points[1].first < points[2].first));
  CHECK((points[0].second > points[1].second && points[1].second > points[2].second));  // up is a smaller y
  CHECK(points[2].first - points[1].first == Approx(points[1].first - points[0].first).margin(0.11));
  CHECK_THAT(chart.markup, Contains("a &lt; b") && Contains("line c2"));

  // A decade takes the same room everywhere; what is not positive has no place.
  const auto decades =
      line_points(svg_chart({.title = "", .x_label = "", .y_label = "", .log_x = true, .log_y = true},
                            std::vector<ChartSeries>{{"s", {0, 1, 10, 100, 5}, {1, 0.1, 1, 10, -1}}}));
  REQUIRE(decades.size() == 3);
  CHECK(decades[1].first - decades[0].first == Approx(decades[2].first - decades[1].first).margin(0.11));
  CHECK(decades[1].second - decades[0].second == Approx(decades[2].second - decades[1].second).margin(0.11));

  const Html empty = svg_chart(options, std::vector<ChartSeries>{{"s", {}, {}}, {"t", {kNan}, {1}}});
  CHECK(check_html(empty.markup).error.empty());
  CHECK_THAT(empty.markup, Contains("nothing was recorded"));
  const Html single = svg_chart(options, std::vector<ChartSeries>{{"<s>", {7}, {3}, 0, true}});
  CHECK(count_of(single, "circle") == 1);
  CHECK_THAT(single.markup, Contains("&lt;s&gt;: 3 at 7"));
  const auto uneven = [&] { svg_chart(options, std::vector<ChartSeries>{{"s", {1, 2}, {1}}}); };
  CHECK_THAT(message_of(uneven, ErrorKind::internal), Contains("2 x and 1 y"));
}

TEST_CASE("chart: labels and legends", "[report]") {
  const ChartOptions options{.title = "t", .x_label = "x", .y_label = "y", .legend = true};
  ChartSeries rising{.name = "rising",
                     .x = {0, 1, 2},
                     .y = {0, 1, 2},
                     .colour = 1,
                     .dashed = true,
                     .labels = {"A", "B", "C"}};
  const ChartSeries points{.name = "points", .x = {0, 2}, .y = {2, 2}, .markers = true, .line = false};
  const Html chart = svg_chart(options, std::vector{rising, points});
  CHECK(check_html(chart.markup).error.empty());
  CHECK_THAT(chart.markup, Contains("line c1 dashed") && !Contains("line c0"));
  for (const char* label : {">A<", ">B<", ">C<", ">rising<", ">points<"})
    CHECK_THAT(chart.markup, Contains(label));
  CHECK_THAT(chart.markup, Contains("key c1 end"));  // right, below: the corner without points

  // Labels of points at one place do not cover one another.
  rising.x = rising.y = {1, 1, 1};
  const std::string at_one = svg_chart(options, std::vector{rising}).markup;
  std::set<std::string> places;
  for (const char* label : {">A<", ">B<", ">C<"}) {
    const std::size_t end = at_one.find(label), begin = at_one.rfind("<text", end);
    places.insert(at_one.substr(begin, end - begin));
  }
  CHECK(places.size() == 3);

  const Html none = svg_chart(options, {});
  CHECK_THAT(none.markup, Contains("nothing was recorded"));
}

TEST_CASE("chart: ticks are round and lie in the range", "[report]") {
  CHECK(axis_ticks(0, 10, false) == std::vector<double>{0, 2, 4, 6, 8, 10});
  CHECK(axis_ticks(0.9, 1200, true) == std::vector<double>{1, 10, 100, 1000});
  const std::vector<double> fine = axis_ticks(1.5, 30, true);
  REQUIRE(fine.size() == 4);
  CHECK(fine[0] == Approx(2));
  CHECK(fine[3] == Approx(20));
  const std::vector<double> narrow = axis_ticks(13, 19, true);
  CHECK(narrow.size() >= 4);
  CHECK(tick_text(1000) == "1K");
  CHECK(tick_text(3e6) == "3M");
  CHECK(tick_text(0.05) == "0.05");
}

TEST_CASE("chart: long lines keep their extremes", "[report]") {
  ChartSeries s{"s", {}, {}};
  for (int i = 0; i < 20000; ++i) {
    s.x.push_back(i);
    s.y.push_back(i == 12345 ? 9 : i == 777 ? -9 : std::sin(0.7 * i));
  }
  const auto points = line_points(svg_chart({.title = "", .x_label = "", .y_label = ""}, std::vector{s}));
  CHECK(points.size() < 800);
  CHECK(points.size() > 400);
  const auto [low, high] = std::minmax_element(
      points.begin(), points.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
  // The two peaks span 18 of 18 * 1.12 units of the axis.
  CHECK(high->second - low->second == Approx((230 - 28 - 40) / 1.12).margin(0.2));
  CHECK(std::is_sorted(points.begin(), points.end(),
                       [](const auto& a, const auto& b) { return a.first < b.first; }));

  CHECK(smoothed(std::vector<double>{1, 2, 6, kNan, 3}, 1) == std::vector<double>{1, 3, 4, 4.5, 3});
  CHECK(smoothed(std::vector<double>{}, 3).empty());
}

TEST_CASE("chart: steps", "[report]") {
  ChartSeries s{"s", {0, 1, 2, 3}, {5, 0, 2}};
  s.steps = true;
  const auto points = line_points(
      svg_chart({.title = "", .x_label = "", .y_label = "", .y_from_zero = true}, std::vector{s}));
  REQUIRE(points.size() == 6);
  for (std::size_t i = 0; i < 6; i += 2) CHECK(points[i].second == points[i + 1].second);
  for (std::size_t i = 1; i < 5; i += 2) CHECK(points[i].first == points[i + 1].first);
  CHECK(points[2].second == Approx(230 - 40));  // zero is the bottom of the frame
}

TEST_CASE("histogram: shares, edges and what is outside", "[report]") {
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

TEST_CASE("page picture: data URIs hold the pixels", "[report]") {
  const auto encoded = [](const std::string& text) {
    return base64({reinterpret_cast<const std::uint8_t*>(text.data()), text.size()});
  };
  for (const auto& [plain, code] : {std::pair{"", ""},
                                    {"f", "Zg=="},
                                    {"fo", "Zm8="},
                                    {"foo", "Zm9v"},
                                    {"foob", "Zm9vYg=="},
                                    {"fooba", "Zm9vYmE="},
                                    {"foobar", "Zm9vYmFy"}})  // RFC 4648
    CHECK(encoded(plain) == code);

  const Image8 small = gradient_image(31, 17);
  const PagePicture exact = page_picture(small, 100);
  CHECK(exact.uri.starts_with("data:image/png;base64,"));
  CHECK(exact.reduced == 1);
  CHECK(exact.bytes == exact.uri.size());
  const cv::Mat pixels = decoded(exact);
  REQUIRE((pixels.cols == 31 && pixels.rows == 17));
  const cv::Vec3b bgr = pixels.at<cv::Vec3b>(5, 7);
  for (std::size_t c = 0; c < 3; ++c) CHECK(bgr[2 - static_cast<int>(c)] == small.rgb[3 * (5 * 31 + 7) + c]);

  Image8 noise = gradient_image(400, 200);
  for (std::size_t i = 0; i < noise.rgb.size(); ++i)
    noise.rgb[i] = static_cast<std::uint8_t>(i * i * 2654435761u >> 13);
  const PagePicture photograph = page_picture(noise, 300);
  CHECK(photograph.uri.starts_with("data:image/jpeg;base64,"));
  CHECK(photograph.reduced == Approx(4.0 / 3));
  CHECK((decoded(photograph).cols == 300 && decoded(photograph).rows == 150));
  CHECK((photograph.width == 300 && photograph.height == 150));
}

TEST_CASE("page picture: error, depth and alpha", "[report]") {
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
  const ValueRange range = depth_range(depth, alpha);
  CHECK(range.low == 2);
  CHECK(range.high == 6);  // the pixel that is hardly covered does not count
  const Image8 picture = depth_image(depth, alpha, 4, 1, range);
  CHECK(sum(picture, 0) > sum(picture, 3));
  CHECK(sum(picture, 3) > sum(picture, 1));
  CHECK(depth_range(std::vector<float>{3, 3}, std::vector<float>{1, 1}).high > 3);
  CHECK(depth_range({}, {}).high == 1);
  CHECK(depth_range(std::vector<float>{3, 5}, std::vector<float>{0, 0}).high == 5);
  const float nan = std::numeric_limits<float>::quiet_NaN();
  CHECK(grey_image(std::vector<float>{0, 0.5f, 2, nan}, 4, 1).rgb ==
        std::vector<std::uint8_t>{0, 0, 0, 128, 128, 128, 255, 255, 255, 0, 0, 0});
  CHECK(sum(error_legend(), 0) < sum(error_legend(), 255));
  CHECK(sum(depth_legend(), 0) > sum(depth_legend(), 255));

  // Channels of mse (1/255)^2, (2/255)^2, (4/255)^2: the mean of the three, not of the mse.
  const double expected = 20 * std::log10(255.0) - 20 * std::log10(1.0 * 2 * 4) / 3;
  CHECK(psnr_channel_mean(Image8{1, 1, {10, 10, 10}}, Image8{1, 1, {11, 8, 14}}) == Approx(expected));
  CHECK(std::isinf(psnr_channel_mean(flat(3), flat(3))));
}
