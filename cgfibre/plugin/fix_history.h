#ifndef CGFIBRE_FIX_HISTORY_H
#define CGFIBRE_FIX_HISTORY_H

#include "fix.h"

#include <string>
#include <vector>

namespace cgfibre {

class FixHistory;

// A pair style whose contacts remember something.
class HistoryOwner {
 public:
  // add() every contact that has a history to `store`, under an owned atom and its partner's tag
  virtual void deposit(FixHistory &store) = 0;
  // a new neighbour list is there: find() the histories of its pairs in `store`
  virtual void restore(const FixHistory &store) = 0;

 protected:
  ~HistoryOwner() = default;    // never deleted by this name
};

// fix ID all CGFIBRE/HISTORY n
//
// Keeps n numbers for each contact of an owned atom with a partner (by its tag) while neighbour lists, and with them the
// pair style's own arrays, do not exist: it travels with the atoms from rank to rank, through sorting and through
// restart files. A pair style makes it by create() (in settings(), so that it stands before fixes that migrate atoms,
// else in init_style()) and removes it in its destructor.
//
// The pair style's arrays are the truth from restore() to the next deposit(), provided it says changed() whenever it has
// altered them. deposit() is called before atoms migrate, when a run ends and when a restart file is written.
//
// A contact across ranks must be added on the rank that will look it up. Either it always lies with the same one atom
// that is owned by the rank that computes it, or, where both ranks compute it (neighbour list with newton off), both
// add it under their own atom, and so does a contact of two owned atoms, twice, once from either side.
class FixHistory : public LAMMPS_NS::Fix {
 public:
  FixHistory(LAMMPS_NS::LAMMPS *lmp, int narg, char **arg);
  ~FixHistory() override;

  // the fix of one pair style under the first free ID "STEM_1", "STEM_2", ...: the same in every run of a deck, so that
  // a restart file's data find it. Letters, digits and underscores only.
  static FixHistory *create(LAMMPS_NS::LAMMPS *lmp, const std::string &stem, int values, HistoryOwner *owner);

  void changed() { current_ = false; }
  void add(int i, LAMMPS_NS::tagint partner, const double *values);
  const double *find(int i, LAMMPS_NS::tagint partner) const;    // null: no history
  int values() const { return values_; }

  int setmask() override;
  void init() override;
  void setup_pre_exchange() override { collect(); }
  void pre_exchange() override { collect(); }
  void min_pre_exchange() override { collect(); }
  void setup_post_neighbor() override;
  void post_neighbor() override { setup_post_neighbor(); }
  void min_post_neighbor() override { setup_post_neighbor(); }
  void post_run() override { collect(); }
  void write_restart(FILE *fp) override;

  void grow_arrays(int nmax) override;
  void copy_arrays(int i, int j, int delflag) override;
  void set_arrays(int i) override;
  int pack_exchange(int i, double *buf) override;
  int unpack_exchange(int nlocal, double *buf) override;
  int pack_restart(int i, double *buf) override;
  void unpack_restart(int nlocal, int nth) override;
  int size_restart(int nlocal) override;
  int maxsize_restart() override;
  double memory_usage() override;

 private:
  int values_;
  HistoryOwner *owner_ = nullptr;
  bool current_ = true;                         // the lists are as new as the owner's arrays
  std::vector<std::vector<double>> contacts_;    // of each owned atom: tag of the partner, its values, and so on

  void collect();
};

}    // namespace cgfibre

#endif
