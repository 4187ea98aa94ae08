#ifndef CGFIBRE_FIX_DISC_SUPPORT_H
#define CGFIBRE_FIX_DISC_SUPPORT_H

#include "curve.h"
#include "fix.h"

#include <string>
#include <vector>

namespace cgfibre {

// fix ID group disc/support linear K | table FILE KEY  [turn KT] [drag G GT] [stiffen v_NAME START END S every N]
//
// What holds the discs of a section, in one pass: a spring in x and y back to where a disc was when the fix was made, by
// a force that depends on the distance alone; a torsional spring KT times its turn about z since then; drag -G v and
// -GT omega; and the plane (forces along z, torques about x and y are zero).
//
// stiffen: contacts that a deck leaves S times too soft become real as they are pressed. Nothing of the contacts is
// touched: the unit of force of everything but the springs is f_ID[5] times the deck's, so the springs act 1/f_ID[5]
// as hard. Every N steps the variable (an overlap) enters a mean over some MEMORY of its values, M; f_ID[5] is
// S^((M - START)/(END - START)), from 1 to S, never falls, and rises by no more than GROWTH at a time. f_ID[7] counts
// steps for the deck's platens, which are to go on by it: from M = START on a step counts SLOW, while the factor lags
// behind CREEP.
//
// f_ID: energy of the springs; f_ID[1-2]: sum of their forces on the discs; f_ID[3]: largest distance; f_ID[4]: the mean
// overlap; f_ID[5]: the factor; f_ID[6]: largest turn; f_ID[7]: steps as above; f_ID[8]:
// what a step counts. Energy and forces are the real ones, in the atoms' forces they
// stand over the factor.
class FixDiscSupport : public LAMMPS_NS::Fix {
 public:
  static constexpr int MEMORY = 5;
  static constexpr double GROWTH = 0.03, SLOW = 0.05, CREEP = 0.002;

  FixDiscSupport(LAMMPS_NS::LAMMPS *lmp, int narg, char **arg);
  ~FixDiscSupport() override;
  int setmask() override;
  void init() override;
  void setup(int vflag) override;
  void post_force(int vflag) override;
  void end_of_step() override;
  double compute_scalar() override;
  double compute_vector(int k) override;

  void write_restart(FILE *fp) override;
  void restart(char *buf) override;
  void grow_arrays(int nmax) override;
  void copy_arrays(int i, int j, int delflag) override;
  void set_arrays(int i) override;
  int pack_exchange(int i, double *buf) override;
  int unpack_exchange(int nlocal, double *buf) override;
  int pack_restart(int i, double *buf) override;
  void unpack_restart(int nlocal, int nth) override;
  int size_restart(int) override { return VALUES + 1; }
  int maxsize_restart() override { return VALUES + 1; }
  double memory_usage() override;

 private:
  enum { ENERGY, FX, FY, SUMS };
  enum { X, Y, TURN, VALUES };
  double k_ = 0, turn_ = 0, drag_ = 0, turning_drag_ = 0;
  Curve law_;    // empty: linear
  std::vector<double> own_;    // VALUES an atom: where it was, how far it has turned since
  std::string overlap_;         // variable; empty: no stiffening
  double start_ = 0, end_ = 1, most_ = 1;
  double state_[4] = {0, 1, 0, 1};    // mean overlap, factor, steps counted, what a step counts
  double mine_[SUMS], all_[SUMS], far_ = 0, turned_ = 0;
  bool summed_ = false;
  int variable_ = -1;

  double *own(int i) { return &own_[static_cast<size_t>(i) * VALUES]; }
  void stiffen(int narg, char **arg, int &iarg);
  void hold(double dt);
  void sum();
};

}    // namespace cgfibre

#endif
