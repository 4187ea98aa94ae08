#ifndef CGFIBRE_FIX_WALL_GRANULAR_TABLE_H
#define CGFIBRE_FIX_WALL_GRANULAR_TABLE_H

#include "contact_law.h"
#include "fix.h"
#include "wall_shape.h"

#include <vector>

namespace cgfibre {

// fix ID group wall/granular/table SHAPE LAW [length L] [damping G] [friction MU ...] [tangential [stiffness] K RATIO]
//   [rolling K G MU] [move x|y|z v_NAME] [rotate v_NAME] [span x|y|z LO HI] [contacts]    (words: WallShape, ContactLaw)
//
// A rigid wall for spheres and discs with the laws of pair granular/table. A body that goes through the surface with its
// centre is pushed back on. Size of the line law: R/2 (1 + R curvature), of a rigid plane and of a rigid cylinder.
//
// f_ID: energy of the contacts (loading curve). f_ID[1-3]: force of the bodies on the wall, f_ID[4]: number of contacts,
// f_ID[5]: energy. With `contacts` an array for each atom: normal force, tangential force on the atom (3), overlap,
// 1 if it slips. Histories, and place and velocity of the wall, are in restart files.
class FixWallGranularTable : public LAMMPS_NS::Fix {
 public:
  FixWallGranularTable(LAMMPS_NS::LAMMPS *lmp, int narg, char **arg);
  ~FixWallGranularTable() override;
  int setmask() override;
  void init() override;
  void setup(int vflag) override;
  void min_setup(int vflag) override { setup(vflag); }
  void post_force(int vflag) override;
  void min_post_force(int vflag) override;
  double compute_scalar() override { return compute_vector(4); }
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
  int size_restart(int) override { return ContactLaw::VALUES + 1; }
  int maxsize_restart() override { return ContactLaw::VALUES + 1; }
  double memory_usage() override;

 private:
  static constexpr int SUMS = 5, COLUMNS = 6;
  WallShape shape_;
  ContactLaw law_;
  std::vector<double> history_;    // ContactLaw::VALUES an atom
  double mine_[SUMS], all_[SUMS];
  bool summed_ = false;

  void press(double dt);
  void interact(int i, const Hit &hit, double dt);
  double *history(int i) { return &history_[static_cast<size_t>(i) * ContactLaw::VALUES]; }
};

}    // namespace cgfibre

#endif
