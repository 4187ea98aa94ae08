#ifndef CGFIBRE_PAIR_GRANULAR_TABLE_H
#define CGFIBRE_PAIR_GRANULAR_TABLE_H

#include "contact_law.h"
#include "fix_history.h"
#include "pair.h"

#include <vector>

namespace cgfibre {

// pair_style granular/table
// pair_coeff I J none | LAW [length L] [damping G] [friction MU [kinetic MU_K]] [tangential [stiffness] K RATIO]
//            [rolling K G MU]                                        (words: ContactLaw)
//
// Spheres and discs with a tabulated (or linear, or line contact) normal force, friction and rolling. No mixing: every
// pair of types wants its own line. Settings are not in restart files (the deck gives them again), histories are.
//
// Two bodies touch at the point that divides the line of centres r as their radii do, arms a_i = r R_i/(R_i + R_j), so
// that forces and torques leave angular momentum as it is. A contact of atoms on two ranks is computed on both.
//
// compute pair/local: force (normal force over distance), eng, and p1 normal force, p2-p4 tangential force on the first
// atom, p5 overlap, p6 1 if it slips: the forces of the last step, not of the velocities since.
class PairGranularTable : public LAMMPS_NS::Pair, public HistoryOwner {
 public:
  PairGranularTable(LAMMPS_NS::LAMMPS *lmp);
  ~PairGranularTable() override;
  void compute(int eflag, int vflag) override;
  void settings(int narg, char **arg) override;
  void coeff(int narg, char **arg) override;
  void init_style() override;
  double init_one(int i, int j) override;
  void setup() override;
  double single(int i, int j, int itype, int jtype, double rsq, double, double, double &fforce) override;
  double memory_usage() override;

  void deposit(FixHistory &store) override;
  void restore(const FixHistory &store) override;

 private:
  struct Candidate {
    int j;
    bool touching;
    double history[ContactLaw::VALUES];
    double normal, t[3], overlap;    // of the last step
  };
  std::vector<Candidate> candidates_;    // in the order of the neighbour list
  std::vector<int> start_;               // of owned atom i: start_[i] to start_[i + 1]
  std::vector<ContactLaw> laws_;         // of types i, j: i stride() + j
  std::vector<double> radius_;           // largest of a type
  FixHistory *history_ = nullptr;
  std::string history_id_;

  const ContactLaw &law(int i, int j) const { return laws_[i * stride() + j]; }
  int stride() const;
  void allocate();
  void make_history();
  void interact(int i, Candidate &candidate, double dt);
  const Candidate *find(int i, int j) const;
};

}    // namespace cgfibre

#endif
