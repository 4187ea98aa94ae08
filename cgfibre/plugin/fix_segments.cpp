#include "fix_segments.h"

#include "atom.h"
#include "comm.h"
#include "domain.h"
#include "error.h"
#include "memory.h"
#include "modify.h"

#include <algorithm>
#include <cmath>
#include <unordered_map>

using namespace LAMMPS_NS;
using namespace cgfibre;

static const char *const NAME = "CGFIBRE_SEGMENTS";

FixSegments::FixSegments(LAMMPS *lmp, int narg, char **arg) :
    Fix(lmp, narg, arg), longest(0.0), following(nullptr), known(false)
{
  comm_border = 1;
  FixSegments::grow_arrays(atom->nmax);
  for (int i = 0; i < atom->nmax; i++) following[i] = 0.0;
  atom->add_callback(Atom::GROW);
  atom->add_callback(Atom::BORDER);
}

FixSegments::~FixSegments()
{
  atom->delete_callback(id, Atom::GROW);
  atom->delete_callback(id, Atom::BORDER);
  memory->destroy(following);
}

FixSegments *FixSegments::of(LAMMPS *lmp)
{
  Fix *found = lmp->modify->get_fix_by_id(NAME);
  if (!found) found = lmp->modify->add_fix(std::string(NAME) + " all CGFIBRE/SEGMENTS", 1);
  return dynamic_cast<FixSegments *>(found);
}

int FixSegments::setmask()
{
  return FixConst::POST_NEIGHBOR;
}

void FixSegments::init()
{
  if (atom->map_style == Atom::MAP_NONE)
    error->all(FLERR, "Filament segments need an atom map: atom_modify map array");
  if (!atom->molecule_flag || atom->molecular != Atom::MOLECULAR)
    error->all(FLERR, "Filament segments need molecule ids and bonds: atom_style molecular, bond or bpm/sphere");
  if (!known) read_bonds();
  known = true;
}

// A bond of beads with neighbouring tags runs from the lower to the higher; one between the ends of a row of such bonds
// closes that filament and runs from its last bead to its first. So it does not matter which of the two stores the bond.
// Bonds of any other beads lead from filament to filament and are no segments: rungs of ribbons.
void FixSegments::read_bonds()
{
  std::vector<tagint> mine, all;
  for (int i = 0; i < atom->nlocal; i++)
    for (int k = 0; k < atom->num_bond[i]; k++) {
      if (atom->bond_type[i][k] <= 0) continue;
      mine.push_back(std::min(atom->tag[i], atom->bond_atom[i][k]));
      mine.push_back(std::max(atom->tag[i], atom->bond_atom[i][k]));
    }
  // a bond may be stored where its first bead is not, so every rank hears of all
  int count = (int) mine.size();
  std::vector<int> counts(comm->nprocs), starts(comm->nprocs, 0);
  MPI_Allgather(&count, 1, MPI_INT, counts.data(), 1, MPI_INT, world);
  for (int p = 1; p < comm->nprocs; p++) starts[p] = starts[p - 1] + counts[p - 1];
  all.resize(starts.back() + counts.back());
  MPI_Allgatherv(mine.data(), count, MPI_LMP_TAGINT, all.data(), counts.data(), starts.data(), MPI_LMP_TAGINT, world);
  std::vector<tagint> on;    // beads with a segment to the next tag, rising
  for (size_t k = 0; k + 1 < all.size(); k += 2)
    if (all[k + 1] - all[k] == 1) on.push_back(all[k]);
  std::sort(on.begin(), on.end());
  on.erase(std::unique(on.begin(), on.end()), on.end());    // with newton off both beads of a bond store it
  std::unordered_map<tagint, tagint> after, first;    // next bead; first bead of the row that ends at a bead
  after.reserve(all.size());
  for (size_t k = 0; k < on.size(); k++) {
    const auto row = first.find(on[k]);
    const tagint begin = row == first.end() ? on[k] : row->second;
    if (row != first.end()) first.erase(row);
    first[on[k] + 1] = begin;
    after[on[k]] = on[k] + 1;
  }
  for (size_t k = 0; k + 1 < all.size(); k += 2) {
    const auto row = first.find(all[k + 1]);
    if (row != first.end() && row->second == all[k] && all[k + 1] - all[k] > 1) after[all[k + 1]] = all[k];
  }
  for (int i = 0; i < atom->nlocal; i++) {
    const auto found = after.find(atom->tag[i]);
    following[i] = found == after.end() ? 0.0 : (double) found->second;
  }
}

void FixSegments::setup_post_neighbor()
{
  post_neighbor();
}

void FixSegments::post_neighbor()
{
  const int nall = atom->nlocal + atom->nghost;
  double **x = atom->x;
  next.assign(nall, -1);
  double longest2 = 0.0;
  for (int i = 0; i < nall; i++) {
    if (following[i] == 0.0) continue;
    int j = atom->map((tagint) following[i]);
    if (j >= 0) j = domain->closest_image(i, j);
    if (i < atom->nlocal) {
      if (j < 0)
        error->one(FLERR, "The bead behind bead {} is missing: a bond is longer than the ghost cutoff (comm_modify)",
                   atom->tag[i]);
      const double dx = x[j][0] - x[i][0], dy = x[j][1] - x[i][1], dz = x[j][2] - x[i][2];
      longest2 = std::max(longest2, dx * dx + dy * dy + dz * dz);
    }
    next[i] = j;
  }
  longest = std::sqrt(longest2);
  MPI_Allreduce(MPI_IN_PLACE, &longest, 1, MPI_DOUBLE, MPI_MAX, world);
  // at the edge of the ghosts the image next to a bead may be missing and another, far one, be found
  for (int i = atom->nlocal; i < nall; i++) {
    const int j = next[i];
    if (j < 0) continue;
    const double dx = x[j][0] - x[i][0], dy = x[j][1] - x[i][1], dz = x[j][2] - x[i][2];
    if (dx * dx + dy * dy + dz * dz > 1.21 * longest * longest) next[i] = -1;
  }
}

double FixSegments::memory_usage()
{
  return (double) atom->nmax * sizeof(double) + (double) next.capacity() * sizeof(int);
}

void FixSegments::grow_arrays(int nmax)
{
  memory->grow(following, nmax, "segments:following");
}

void FixSegments::copy_arrays(int i, int j, int)
{
  following[j] = following[i];
}

void FixSegments::set_arrays(int i)
{
  following[i] = 0.0;
}

int FixSegments::pack_exchange(int i, double *buf)
{
  buf[0] = following[i];
  return 1;
}

int FixSegments::unpack_exchange(int i, double *buf)
{
  following[i] = buf[0];
  return 1;
}

int FixSegments::pack_border(int n, int *list, double *buf)
{
  for (int k = 0; k < n; k++) buf[k] = following[list[k]];
  return n;
}

int FixSegments::unpack_border(int n, int first, double *buf)
{
  for (int k = 0; k < n; k++) following[first + k] = buf[k];
  return n;
}
