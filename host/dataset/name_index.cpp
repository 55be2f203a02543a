// SPDX-License-Identifier: Apache-2.0
// See name_index.hpp.
#include "host/dataset/name_index.hpp"

#include <algorithm>
#include <array>
#include <set>
#include <tuple>

#include "host/base/text.hpp"

namespace ubs {
namespace {

// AccentRow contains pairs of a letter and the same letter with the accent `accent`. The rows are from the
// Unicode database (canonical decompositions of the Latin, Greek, Cyrillic and Japanese letters). The
// decompositions of Korean syllables are computed instead.
struct AccentRow {
  char32_t accent;
  std::u16string_view pairs;
};
constexpr AccentRow kAccents[] = {
    {0x0300,
     u"AÀEÈIÌOÒUÙaàeèiìoòuùÜǛüǜNǸnǹЕЀИЍеѐиѝĒḔēḕŌṐōṑWẀwẁÂẦâầĂẰăằÊỀêềÔỒôồ"
     u"ƠỜơờƯỪưừYỲyỳἀἂἁἃἈἊἉἋἐἒἑἓἘἚἙἛἠἢἡἣἨἪἩἫἰἲἱἳἸἺἹἻὀὂὁὃὈὊὉὋὐὒὑὓὙὛὠὢὡὣὨὪ"
     u"ὩὫαὰεὲηὴιὶοὸυὺωὼΑᾺΕῈΗῊ᾿῍ϊῒΙῚ῾῝ϋῢΥῪ¨῭ΟῸΩῺ"},
    {0x0301,
     u"AÁEÉIÍOÓUÚYÝaáeéiíoóuúyýCĆcćLĹlĺNŃnńRŔrŕSŚsśZŹzźÜǗüǘGǴgǵÅǺåǻÆǼæǽ"
     u"ØǾøǿ¨΅ΑΆΕΈΗΉΙΊΟΌΥΎΩΏϊΐαάεέηήιίϋΰοόυύωώϒϓГЃКЌгѓкќÇḈçḉĒḖēḗÏḮïḯKḰkḱ"
     u"MḾmḿÕṌõṍŌṒōṓPṔpṕŨṸũṹWẂwẃÂẤâấĂẮăắÊẾêếÔỐôốƠỚơớƯỨưứἀἄἁἅἈἌἉἍἐἔἑἕἘἜἙἝ"
     u"ἠἤἡἥἨἬἩἭἰἴἱἵἸἼἹἽὀὄὁὅὈὌὉὍὐὔὑὕὙὝὠὤὡὥὨὬὩὭ᾿῎῾῞"},
    {0x0302, u"AÂEÊIÎOÔUÛaâeêiîoôuûCĈcĉGĜgĝHĤhĥJĴjĵSŜsŝWŴwŵYŶyŷZẐzẑẠẬạậẸỆẹệỌỘọộ"},
    {0x0303, u"AÃNÑOÕaãnñoõIĨiĩUŨuũVṼvṽÂẪâẫĂẴăẵEẼeẽÊỄêễÔỖôỗƠỠơỡƯỮưữYỸyỹ"},
    {0x0304,
     u"AĀaāEĒeēIĪiīOŌoōUŪuūÜǕüǖÄǞäǟȦǠȧǡÆǢæǣǪǬǫǭÖȪöȫÕȬõȭȮȰȯȱYȲyȳИӢиӣУӮуӯ"
     u"GḠgḡḶḸḷḹṚṜṛṝαᾱΑᾹιῑΙῙυῡΥῩ"},
    {0x0306, u"AĂaăEĔeĕGĞgğIĬiĭOŎoŏUŬuŭУЎИЙийуўЖӁжӂАӐаӑЕӖеӗȨḜȩḝẠẶạặαᾰΑᾸιῐΙῘυῠΥῨ"},
    {0x0307,
     u"CĊcċEĖeėGĠgġIİZŻzżAȦaȧOȮoȯBḂbḃDḊdḋFḞfḟHḢhḣMṀmṁNṄnṅPṖpṗRṘrṙSṠsṡŚṤ"
     u"śṥŠṦšṧṢṨṣṩTṪtṫWẆwẇXẊxẋYẎyẏſẛ"},
    {0x0308,
     u"AÄEËIÏOÖUÜaäeëiïoöuüyÿYŸΙΪΥΫιϊυϋϒϔЕЁІЇеёіїАӒаӓӘӚәӛЖӜжӝЗӞзӟИӤиӥОӦ"
     u"оӧӨӪөӫЭӬэӭУӰуӱЧӴчӵЫӸыӹHḦhḧÕṎõṏŪṺūṻWẄwẅXẌxẍtẗ"},
    {0x0309, u"AẢaảÂẨâẩĂẲăẳEẺeẻÊỂêểIỈiỉOỎoỏÔỔôổƠỞơởUỦuủƯỬưửYỶyỷ"},
    {0x030a, u"AÅaåUŮuůwẘyẙ"},
    {0x030b, u"OŐoőUŰuűУӲуӳ"},
    {0x030c,
     u"CČcčDĎdďEĚeěLĽlľNŇnňRŘrřSŠsšTŤtťZŽzžAǍaǎIǏiǐOǑoǒUǓuǔÜǙüǚGǦgǧKǨkǩ"
     u"ƷǮʒǯjǰHȞhȟ"},
    {0x030f, u"AȀaȁEȄeȅIȈiȉOȌoȍRȐrȑUȔuȕѴѶѵѷ"},
    {0x0311, u"AȂaȃEȆeȇIȊiȋOȎoȏRȒrȓUȖuȗ"},
    {0x0313, u"αἀΑἈεἐΕἘηἠΗἨιἰΙἸοὀΟὈυὐωὠΩὨρῤ"},
    {0x0314, u"αἁΑἉεἑΕἙηἡΗἩιἱΙἹοὁΟὉυὑΥὙωὡΩὩρῥΡῬ"},
    {0x031b, u"OƠoơUƯuư"},
    {0x0323,
     u"BḄbḅDḌdḍHḤhḥKḲkḳLḶlḷMṂmṃNṆnṇRṚrṛSṢsṣTṬtṭVṾvṿWẈwẉZẒzẓAẠaạEẸeẹIỊiị"
     u"OỌoọƠỢơợUỤuụƯỰưựYỴyỵ"},
    {0x0324, u"UṲuṳ"},
    {0x0325, u"AḀaḁ"},
    {0x0326, u"SȘsșTȚtț"},
    {0x0327, u"CÇcçGĢgģKĶkķLĻlļNŅnņRŖrŗSŞsşTŢtţEȨeȩDḐdḑHḨhḩ"},
    {0x0328, u"AĄaąEĘeęIĮiįUŲuųOǪoǫ"},
    {0x032d, u"DḒdḓEḘeḙLḼlḽNṊnṋTṰtṱUṶuṷ"},
    {0x032e, u"HḪhḫ"},
    {0x0330, u"EḚeḛIḬiḭUṴuṵ"},
    {0x0331, u"BḆbḇDḎdḏKḴkḵLḺlḻNṈnṉRṞrṟTṮtṯZẔzẕhẖ"},
    {0x0342, u"ἀἆἁἇἈἎἉἏἠἦἡἧἨἮἩἯἰἶἱἷἸἾἹἿὐὖὑὗὙὟὠὦὡὧὨὮὩὯαᾶ¨῁ηῆ᾿῏ιῖϊῗ῾῟υῦϋῧωῶ"},
    {0x0345,
     u"ἀᾀἁᾁἂᾂἃᾃἄᾄἅᾅἆᾆἇᾇἈᾈἉᾉἊᾊἋᾋἌᾌἍᾍἎᾎἏᾏἠᾐἡᾑἢᾒἣᾓἤᾔἥᾕἦᾖἧᾗἨᾘἩᾙἪᾚἫᾛἬᾜἭᾝἮᾞἯᾟ"
     u"ὠᾠὡᾡὢᾢὣᾣὤᾤὥᾥὦᾦὧᾧὨᾨὩᾩὪᾪὫᾫὬᾬὭᾭὮᾮὯᾯὰᾲαᾳάᾴᾶᾷΑᾼὴῂηῃήῄῆῇΗῌὼῲωῳώῴῶῷΩῼ"},
    {0x3099,
     u"かがきぎくぐけげこごさざしじすずせぜそぞただちぢつづてでとどはばひびふぶへべほぼうゔゝゞカガキギクグケ"
     u"ゲコゴサザシジスズセゼソゾ"
     u"タダチヂツヅテデトドハバヒビフブヘベホボウヴワヷヰヸヱヹヲヺヽヾ"},
    {0x309a, u"はぱひぴふぷへぺほぽハパヒピフプヘペホポ"},
};

struct Decomposed {
  char32_t letter = 0, accent = 0;
};

const std::unordered_map<char32_t, Decomposed>& decompositions() {
  static const auto table = [] {
    std::unordered_map<char32_t, Decomposed> result;
    for (const AccentRow& row : kAccents)
      for (std::size_t i = 0; i + 1 < row.pairs.size(); i += 2)
        result[row.pairs[i + 1]] = {row.pairs[i], row.accent};
    return result;
  }();
  return table;
}

// Converts ASCII, Greek and Cyrillic capitals, and some Latin capitals that have no decomposition, to lower
// case. The caller decomposes accented letters first.
char32_t small_letter(char32_t c) {
  if (c >= U'A' && c <= U'Z') return c + 32;
  if (c >= 0x391 && c <= 0x3a9) return c + 32;
  if (c >= 0x410 && c <= 0x42f) return c + 32;
  if (c >= 0x400 && c <= 0x40f) return c + 80;
  if (c == 0xc6 || c == 0xd0 || c == 0xd8 || c == 0xde) return c + 32;  // AE, Eth, O with stroke, Thorn
  if (c == 0x110 || c == 0x141 || c == 0x152) return c + 1;             // D and L with stroke, OE
  return c;
}

void put_utf8(std::string& text, char32_t c) {
  const auto byte = [&](char32_t value) { text += static_cast<char>(value); };
  if (c < 0x80) {
    byte(c);
  } else if (c < 0x800) {
    byte(0xc0 | c >> 6), byte(0x80 | (c & 0x3f));
  } else if (c < 0x10000) {
    byte(0xe0 | c >> 12), byte(0x80 | (c >> 6 & 0x3f)), byte(0x80 | (c & 0x3f));
  } else {
    byte(0xf0 | c >> 18), byte(0x80 | (c >> 12 & 0x3f)), byte(0x80 | (c >> 6 & 0x3f));
    byte(0x80 | (c & 0x3f));
  }
}

// Appends the canonical decomposition of a character, converted to lower case. A Korean syllable consists of
// a leading consonant, a vowel and optionally a trailing consonant (Unicode standard, 3.12).
void put_decomposed(std::string& text, char32_t c) {
  constexpr char32_t kSyllables = 0xac00, kVowels = 21, kTrails = 28, kLast = 0xd7a3;
  if (c >= kSyllables && c <= kLast) {
    const char32_t index = c - kSyllables;
    put_utf8(text, 0x1100 + index / (kVowels * kTrails));
    put_utf8(text, 0x1161 + index % (kVowels * kTrails) / kTrails);
    if (index % kTrails) put_utf8(text, 0x11a7 + index % kTrails);
    return;
  }
  const auto found = decompositions().find(c);
  if (found == decompositions().end()) return put_utf8(text, small_letter(c));
  put_decomposed(text, found->second.letter);
  put_utf8(text, found->second.accent);
}

char32_t code_at(std::string_view text, std::size_t at, std::size_t length) {
  const auto byte = [&](std::size_t i) { return static_cast<char32_t>(static_cast<unsigned char>(text[i])); };
  if (length == 1) return byte(at);
  char32_t code = byte(at) & (0xff >> (length + 1));
  for (std::size_t i = 1; i < length; ++i) code = code << 6 | (byte(at + i) & 0x3f);
  return code;
}

std::string_view extension_of(std::string_view name) {
  const std::size_t dot = name.rfind('.');
  return dot == std::string_view::npos || dot == 0 ? std::string_view() : name.substr(dot);
}

// Returns a folded file name without its image extension, because the file on disk may have another image
// extension.
std::string_view stem_of(std::string_view name) {
  return has_picture_extension(name) ? name.substr(0, name.size() - extension_of(name).size()) : name;
}

std::string last_component(std::string_view path) {
  const std::vector<std::string> parts = path_components(path);
  return parts.empty() ? std::string() : parts.back();
}

}  // namespace

std::string folded_name(std::string_view name) {
  std::string result;
  result.reserve(name.size());
  for (std::size_t i = 0; i < name.size();) {
    const std::size_t length = utf8_length(name, i);
    if (length == 0) {
      result += name[i++];
      continue;
    }
    const char32_t code = code_at(name, i, length);
    if (code == U'\\')
      result += '/';
    else if (code < 0x80)
      result += static_cast<char>(small_letter(code));
    else
      put_decomposed(result, code);
    i += length;
  }
  return result;
}

std::vector<std::string> path_components(std::string_view path) {
  std::vector<std::string> parts;
  for (std::size_t at = 0; at <= path.size();) {
    const std::size_t end = std::min(path.find_first_of("/\\", at), path.size());
    const std::string_view part = path.substr(at, end - at);
    at = end + 1;
    const bool drive = parts.empty() && part.size() == 2 && part[1] == ':';
    if (part.empty() || part == "." || drive) continue;
    if (part != "..")
      parts.emplace_back(part);
    else if (!parts.empty())
      parts.pop_back();
  }
  return parts;
}

bool has_picture_extension(std::string_view name) {
  static const std::set<std::string> kKnown{".png",  ".jpg",  ".jpeg", ".jpe", ".jfif", ".exr",  ".tif",
                                            ".tiff", ".webp", ".bmp",  ".gif", ".avif", ".heic", ".heif",
                                            ".jxl",  ".jp2",  ".dng",  ".cr2", ".nef",  ".arw"};
  return kKnown.contains(folded_name(extension_of(name)));
}

void NameIndex::add(const std::string& path) {
  Entry entry{path, path_components(folded_name(path))};
  if (!entry.folded.empty()) by_stem_[std::string(stem_of(entry.folded.back()))].push_back(entries_.size());
  entries_.push_back(std::move(entry));
}

const std::vector<std::size_t>& NameIndex::same_stem(std::string_view path) const {
  static const std::vector<std::size_t> kNone;
  const auto found = by_stem_.find(std::string(stem_of(last_component(folded_name(path)))));
  return found == by_stem_.end() ? kNone : found->second;
}

std::optional<NameIndex::Match> NameIndex::best(std::string_view path,
                                                const std::vector<std::size_t>& candidates) const {
  const std::vector<std::string> wanted = path_components(folded_name(path));
  if (wanted.empty()) return std::nullopt;
  const std::string spelling = last_component(path);
  using Rank = std::tuple<std::size_t, bool, bool>;
  std::optional<Match> result;
  Rank highest{};
  std::size_t equals = 0;
  for (const std::size_t number : candidates) {
    const std::vector<std::string>& parts = entries_[number].folded;
    std::size_t alike = 1;  // all candidates have the same last component, except for its extension
    while (alike < std::min(parts.size(), wanted.size()) &&
           parts[parts.size() - 1 - alike] == wanted[wanted.size() - 1 - alike])
      ++alike;
    const Rank rank{alike, parts.back() == wanted.back(), last_component(entries_[number].path) == spelling};
    if (result && rank < highest) continue;
    equals = result && rank == highest ? equals + 1 : 1;
    highest = rank;
    result = Match{number, alike == wanted.size() && alike == parts.size()};
  }
  return equals == 1 ? result : std::nullopt;
}

std::string NameIndex::nearest(std::string_view path) const {
  const std::string wanted = last_component(folded_name(path));
  std::string result;
  // A name is similar if at most half of the bytes, or two bytes of a short name, must be changed.
  std::size_t least = std::max<std::size_t>(wanted.size() / 2, 2) + 1;
  for (const Entry& entry : entries_) {
    if (entry.folded.empty()) continue;
    const std::string& name = entry.folded.back();
    if (name.size() >= wanted.size() + least || wanted.size() >= name.size() + least) continue;
    if (const std::size_t changes = edit_distance(wanted, name); changes < least)
      least = changes, result = entry.path;
  }
  return result;
}

}  // namespace ubs
