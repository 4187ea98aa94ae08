// pair_style capsule: smooth contact of filaments, segment to segment.
//
// A filament is the polyline through its bonded beads with a round section. Each point of the filament of the lower
// molecule id is given to the nearest point of the other filament: to the segment between whose end planes it lies (at a
// bead: the plane that halves the angle of its two segments), so no stretch counts twice or not at all. The force per
// length is the normal law at the overlap there, integrated in closed limits (where overlap and planes begin and end) by
// two Gauss points: exact for the linear law, parallel and crossing alike. One friction spring a pair of segments acts at
// the middle of the force on the surface.

#ifndef CGFIBRE_PAIR_CAPSULE_H
#define CGFIBRE_PAIR_CAPSULE_H

#include "atom.h"
#include "pair.h"

#include "fix_history.h"
#include "friction_law.h"
#include "normal_law.h"
#include "segment_search.h"

#include <cmath>
#include <unordered_map>
#include <vector>

namespace cgfibre {

class FixSegments;

// what one pair of segments is found to do; forces on the first, of the lower molecule where pairs are found once
struct CapsuleContact {
  double normal = 0.0;    // sum of the normal forces, nN
  double friction[3] = {0.0, 0.0, 0.0};
  double force[3] = {0.0, 0.0, 0.0};    // both
  double point[3] = {0.0, 0.0, 0.0};    // where the surfaces touch
  double length = 0.0;         // of the touching stretch, um
  double distance = 0.0;       // least distance of the axes in it, um
  double cosine = 1.0;         // of the angle between the axes
  double energy = 0.0;
  bool slipping = false;

  double angle() const { return std::acos(std::fmin(1.0, cosine)) * 180.0 / 3.14159265358979323846; }    // degrees
};

class PairCapsule : public LAMMPS_NS::Pair, public HistoryOwner {
 public:
  PairCapsule(LAMMPS_NS::LAMMPS *);
  ~PairCapsule() override;

  void compute(int, int) override;
  void settings(int, char **) override;
  void coeff(int, char **) override;
  void init_style() override;
  double init_one(int, int) override;
  double single(int, int, int, int, double, double, double, double &) override;
  double memory_usage() override;
  void deposit(FixHistory &) override;
  void restore(const FixHistory &) override;

  // calls row(first bead of the one segment, of the other, contact) for every touching pair of this rank
  template <class Row> void for_contacts(Row row);

 private:
  static constexpr int HISTORY = 6;    // friction spring (3), whether it slips, deepest overlap at the two points

  struct Coefficients {
    NormalLaw law;
    FrictionLaw friction;
    double damping = 0.0;       // nN us/um a um of contact
    double tangential = 0.8;    // tangential over normal secant stiffness
    double sliding = 0.3;       // tangential over normal damping
    bool given = false;
  };
  struct Segment {
    double x[3], y[3], t[3], length, inverse, radius;    // first and second bead, from the one to the other
    double v[3], dv[3];           // velocity at the first bead, and from the first to the second
    double before[3], after[3];   // normals of the planes at its ends
    int first, second, previous, following;    // beads, -1: none
    int back, front;    // places of the segments before and behind, -1: not here
  };
  struct Stretch {    // of A in contact: |p0 + s m|^2 = C + D^2 + 2 Q s + M s^2 from B's axis, lo < s < hi
    double p0[3], m[3], b, e, C, Q, M, lo, hi;
  };
  struct Load {    // on the four beads, and couples for rods
    double force[4][3], torque[4][3];
  };

  struct Ended {    // a contact that has just ended
    int segment;
    double history[HISTORY];
  };

  double reach;    // longest segment that touches, um
  bool spin;       // beads turn with the filament
  bool two_sided;  // every pair is found twice, from either segment, with half the force
  std::vector<Coefficients> coefficients;    // of pairs of types
  std::vector<char> active;                  // types whose segments touch

  FixSegments *chain;
  FixHistory *store;
  std::vector<Segment> segments;      // that are in some pair
  std::vector<int> masters, rows;     // segment of a row of partners, start of the row
  std::vector<int> partners;
  std::vector<double> history;        // HISTORY values a partner
  std::vector<SearchSegment> near;
  std::vector<Ended> lost;    // of one row in this step
  std::unordered_map<LAMMPS_NS::tagint, int> row_of;    // by the first bead's tag
  SegmentSearch search;
  bool stale;    // neighbour lists are new: pairs have to be found again
  bool warned;

  const Coefficients &of_types(int i, int j) const
  {
    return coefficients[i * (atom->ntypes + 1) + j];
  }
  void allocate();
  void find_pairs();
  void place_segments();
  static bool meet(const Segment &, const Segment &, Stretch &);
  template <bool SPIN>
  void press(const Segment &, const Segment &, const Stretch &, const Coefficients &, double *, bool, bool, CapsuleContact &,
             Load &) const;
  bool inherit(std::size_t, int);
  template <bool SPIN> void add_forces();
  bool look(int, int, CapsuleContact &);
  void tally(const Segment &, const Segment &, const CapsuleContact &, const Load &);
};

template <class Row> void PairCapsule::for_contacts(Row row)
{
  place_segments();
  CapsuleContact contact;
  for (std::size_t m = 0; m < masters.size(); m++)
    for (int k = rows[m]; k < rows[m + 1]; k++) {
      const Segment &one = segments[masters[m]], &other = segments[partners[k]];
      if (look(m, k, contact)) row(one.first, other.first, contact);
    }
}

}    // namespace cgfibre

#endif
