#ifndef CGFIBRE_TABLE_FILE_H
#define CGFIBRE_TABLE_FILE_H

#include <string>
#include <vector>

namespace LAMMPS_NS {
class LAMMPS;
}

namespace cgfibre {

// One section of a table file, read by rank 0 and known to all:
//
//   # comments and blank lines anywhere
//   KEYWORD
//   N 3
//   1 0.0 0.0        index (1..N in order), argument, value
//   2 0.1 250.0
//   3 0.2 700.0
//
// Arguments must rise. Every complaint goes to error->all and names file, section, row, value and what was expected.
class TableFile {
 public:
  TableFile(LAMMPS_NS::LAMMPS *lmp, const std::string &file, const std::string &keyword);

  std::vector<double> x, y;

  [[noreturn]] void fail(const std::string &what, const std::string &value, const std::string &expected) const;
  [[noreturn]] void fail_row(size_t row, const std::string &what, double value, const std::string &expected) const;

 private:
  LAMMPS_NS::LAMMPS *lmp_;
  std::string file_, keyword_;

  std::string text() const;
};

// arg[iarg] as a number, iarg advanced; complains with `what` and `expected` when it is missing, no number, or not
// (at_least <= number)
double number(LAMMPS_NS::LAMMPS *lmp, int narg, char **arg, int &iarg, const char *what, double at_least);
double positive(LAMMPS_NS::LAMMPS *lmp, int narg, char **arg, int &iarg, const char *what);
std::string word(LAMMPS_NS::LAMMPS *lmp, int narg, char **arg, int &iarg, const char *what);

}    // namespace cgfibre

#endif
