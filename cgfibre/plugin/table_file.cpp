#include "table_file.h"

#include "comm.h"
#include "error.h"
#include "fmt/format.h"
#include "lammps.h"
#include "utils.h"

#include <cmath>
#include <fstream>
#include <mpi.h>
#include <sstream>

using namespace cgfibre;
using LAMMPS_NS::LAMMPS;

namespace {

// the whole of `text` as a finite number
bool parse(const std::string &text, double &value)
{
  char *end = nullptr;
  value = std::strtod(text.c_str(), &end);
  return !text.empty() && *end == '\0' && std::isfinite(value);
}

// next line's words without comment; empty at the end
std::vector<std::string> next_words(std::istringstream &in)
{
  std::string line;
  while (std::getline(in, line)) {
    std::istringstream words(line.substr(0, line.find('#')));
    std::vector<std::string> found;
    for (std::string w; words >> w;) found.push_back(w);
    if (!found.empty()) return found;
  }
  return {};
}

std::string join(const std::vector<std::string> &words)
{
  std::string all;
  for (const auto &w : words) all += (all.empty() ? "" : " ") + w;
  return all.empty() ? "end of file" : all;
}

}    // namespace

TableFile::TableFile(LAMMPS *lmp, const std::string &file, const std::string &keyword) :
    lmp_(lmp), file_(file), keyword_(keyword)
{
  std::istringstream in(text());
  std::vector<std::string> words;
  do words = next_words(in);
  while (!words.empty() && (words.size() != 1 || words[0] != keyword));
  if (words.empty()) fail("section", keyword, "a line with this keyword alone");

  words = next_words(in);
  double count = 0;
  if (words.size() != 2 || words[0] != "N" || !parse(words[1], count) || count < 2 || count != std::floor(count))
    fail("line after the keyword", join(words), "N and the number of rows, at least 2");
  const size_t n = static_cast<size_t>(count);
  for (size_t row = 1; row <= n; row++) {
    words = next_words(in);
    double index, a, b;
    if (words.size() != 3 || !parse(words[0], index) || !parse(words[1], a) || !parse(words[2], b))
      fail(fmt::format("row {}", row), join(words), "three numbers: index, argument, value");
    if (index != static_cast<double>(row)) fail_row(row, "index", index, fmt::format("{}", row));
    if (!x.empty() && a <= x.back()) fail_row(row, "argument", a, fmt::format("more than {} before it", x.back()));
    x.push_back(a);
    y.push_back(b);
  }
}

std::string TableFile::text() const
{
  std::string text;
  int size = -1;
  if (lmp_->comm->me == 0) {
    std::ifstream in(file_);
    if (in) {
      std::ostringstream all;
      all << in.rdbuf();
      text = all.str();
      size = static_cast<int>(text.size());
    }
  }
  MPI_Bcast(&size, 1, MPI_INT, 0, lmp_->world);
  if (size < 0) fail("file", "unreadable", "a table file");
  text.resize(size);
  MPI_Bcast(&text[0], size, MPI_CHAR, 0, lmp_->world);
  return text;
}

void TableFile::fail(const std::string &what, const std::string &value, const std::string &expected) const
{
  lmp_->error->all(FLERR, "table {} of file {}: {} is {}, expected {}", keyword_, file_, what, value, expected);
}

void TableFile::fail_row(size_t row, const std::string &what, double value, const std::string &expected) const
{
  fail(fmt::format("{} of row {}", what, row), fmt::format("{}", value), expected);
}

std::string cgfibre::word(LAMMPS *lmp, int narg, char **arg, int &iarg, const char *what)
{
  if (iarg >= narg) lmp->error->all(FLERR, "{} is missing", what);
  return arg[iarg++];
}

double cgfibre::number(LAMMPS *lmp, int narg, char **arg, int &iarg, const char *what, double at_least)
{
  const std::string text = word(lmp, narg, arg, iarg, what);
  double value;
  if (!parse(text, value) || value < at_least)
    lmp->error->all(FLERR, "{} is {}, expected a number of at least {}", what, text, at_least);
  return value;
}

double cgfibre::positive(LAMMPS *lmp, int narg, char **arg, int &iarg, const char *what)
{
  const std::string text = word(lmp, narg, arg, iarg, what);
  double value;
  if (!parse(text, value) || value <= 0) lmp->error->all(FLERR, "{} is {}, expected a number above 0", what, text);
  return value;
}
