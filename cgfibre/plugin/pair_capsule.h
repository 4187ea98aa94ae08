// pair_style capsule: smooth contact of filaments, segment to segment.
//
// A filament is the polyline through its bonded beads with a round section. Each point of the filament of the lower
// molecule id is given to the nearest point of the other filament: to the segment between whose end planes it lies (at a
// bead: the plane that halves the angle of its two segments), so no stretch counts twice or not at all. The force per
// length is the normal law at the overlap there, integrated in closed limits (where overlap and planes begin and end) by
// two Gauss points: exact for the linear law, parallel and crossing alike. One friction spring a pair of segments acts at
// the middle of the force on the surface. Pairs are worked through eight at a time (capsule_lanes.h).

#ifndef CGFIBRE_PAIR_CAPSULE_H
#define CGFIBRE_PAIR_CAPSULE_H

#include "atom.h"
#include "pair.h"

#include "capsule_lanes.h"
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
  static constexpr int HISTORY = PressLanes::HISTORY;

  struct Coefficients {
    NormalLaw law;
    FrictionLaw friction;
    double damping = 0.0;       // nN us/um a um of contact
    double tangential = 0.8;    // tangential over normal secant stiffness
    double sliding = 0.3;       // tangential over normal damping
    bool given = false;
  };
  struct Beads {    // of a segment and of those beside it, -1: none
    int first, second, previous, following;
    int back, front;    // places of the segments before and behind, -1: not here
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

  const LaneKernels *kernels;
  FixSegments *chain;
  FixHistory *store;
  std::vector<Segment> segments;      // that are in some pair
  std::vector<Beads> beads;           // of theirs
  std::vector<int> masters, rows;     // segment of a row of partners, start of the row
  std::vector<int> partners;
  std::vector<double> history;        // HISTORY values a partner
  std::vector<char> held;             // whether its friction spring is stretched
  std::vector<SearchSegment> near;
  std::vector<Ended> lost;    // of one row in this step
  std::size_t lost_row;
  // candidates and stretches in contact that wait for their lanes to be full
  MeetLanes meeting;
  PressLanes pressing;
  struct Waiting {
    int master, partner;    // index of the row, of the pair
  };
  Waiting candidates[LANES], touching[LANES];
  int candidate_count, touching_count;
  double contacts, contact_length, closest;
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
  void carry_with_box();
  void fill(PressLanes &, int lane, const Waiting &, double lo, double hi, double *h) const;
  void press(PressLanes &, int count) const;
  CapsuleContact contact_of(const PressLanes &, int lane) const;
  void inherit(std::size_t, int);
  void sort_out();
  void add_forces();
  void add_loads();
  bool look(int, int, CapsuleContact &);
  void tally(const int *, const PressLanes &, int lane);
};

template <class Row> void PairCapsule::for_contacts(Row row)
{
  place_segments();
  CapsuleContact contact;
  for (std::size_t m = 0; m < masters.size(); m++)
    for (int k = rows[m]; k < rows[m + 1]; k++) {
      const Beads &one = beads[masters[m]], &other = beads[partners[k]];
      if (look(m, k, contact)) row(one.first, other.first, contact);
    }
}

}    // namespace cgfibre

#endif
