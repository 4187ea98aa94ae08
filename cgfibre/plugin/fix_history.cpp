#include "fix_history.h"

#include "atom.h"
#include "comm.h"
#include "error.h"
#include "fmt/format.h"
#include "lammps.h"
#include "modify.h"
#include "utils.h"

#include <algorithm>
#include <mpi.h>

using namespace cgfibre;
using namespace LAMMPS_NS;

FixHistory::FixHistory(LAMMPS *lmp, int narg, char **arg) : Fix(lmp, narg, arg)
{
  if (narg != 4) error->all(FLERR, "fix CGFIBRE/HISTORY takes the number of values of a contact");
  values_ = utils::inumeric(FLERR, arg[3], false, lmp);
  if (values_ < 1) error->all(FLERR, "values of fix CGFIBRE/HISTORY are {}, expected at least 1", values_);
  restart_peratom = 1;
  restart_global = 1;    // write_restart() below, to collect in time
  create_attribute = 1;
  stores_ids = 1;
  maxexchange_dynamic = 1;
  maxexchange = 1;
  grow_arrays(atom->nmax);
  atom->add_callback(Atom::GROW);
  atom->add_callback(Atom::RESTART);
}

FixHistory::~FixHistory()
{
  atom->delete_callback(id, Atom::GROW);
  atom->delete_callback(id, Atom::RESTART);
}

FixHistory *FixHistory::create(LAMMPS *lmp, const std::string &stem, int values, HistoryOwner *owner)
{
  int k = 1;
  while (lmp->modify->get_fix_by_id(fmt::format("{}_{}", stem, k))) k++;
  Fix *made = lmp->modify->add_fix(fmt::format("{}_{} all CGFIBRE/HISTORY {}", stem, k, values));
  auto *fix = dynamic_cast<FixHistory *>(made);
  fix->owner_ = owner;
  return fix;
}

int FixHistory::setmask()
{
  using namespace FixConst;
  return PRE_EXCHANGE | POST_NEIGHBOR | POST_RUN | MIN_PRE_EXCHANGE | MIN_POST_NEIGHBOR;
}

void FixHistory::init()
{
  if (owner_ == nullptr) error->all(FLERR, "fix CGFIBRE/HISTORY is made by a pair style, not by a deck");
  for (Fix *fix : modify->get_fix_list()) {
    if (fix == this) break;
    if (fix->pre_exchange_migrate)
      error->all(FLERR, "fix {} moves atoms to other ranks before contacts are stored, expected after pair_style", fix->id);
  }
}

void FixHistory::add(int i, tagint partner, const double *values)
{
  std::vector<double> &list = contacts_[i];
  list.push_back(static_cast<double>(partner));
  list.insert(list.end(), values, values + values_);
}

const double *FixHistory::find(int i, tagint partner) const
{
  const std::vector<double> &list = contacts_[i];
  const double wanted = static_cast<double>(partner);
  for (size_t k = 0; k < list.size(); k += values_ + 1)
    if (list[k] == wanted) return &list[k + 1];
  return nullptr;
}

// the owner's histories into the lists, unless they are there already; the largest list of all ranks for the exchange
void FixHistory::collect()
{
  if (!current_) {
    for (auto &list : contacts_) list.clear();
    owner_->deposit(*this);
    current_ = true;
  }
  int largest = 0;
  for (int i = 0; i < atom->nlocal; i++) largest = std::max(largest, static_cast<int>(contacts_[i].size()) + 1);
  MPI_Allreduce(&largest, &maxexchange, 1, MPI_INT, MPI_MAX, world);
}

void FixHistory::setup_post_neighbor()
{
  owner_->restore(*this);
}

// called on all ranks before they pack their atoms
void FixHistory::write_restart(FILE *fp)
{
  collect();
  if (comm->me == 0) {
    const int size = 0;
    fwrite(&size, sizeof size, 1, fp);
  }
}

void FixHistory::grow_arrays(int nmax)
{
  if (static_cast<int>(contacts_.size()) < nmax) contacts_.resize(nmax);
}

void FixHistory::copy_arrays(int i, int j, int /*delflag*/)
{
  contacts_[j] = contacts_[i];
}

void FixHistory::set_arrays(int i)
{
  contacts_[i].clear();
}

int FixHistory::pack_exchange(int i, double *buf)
{
  const std::vector<double> &list = contacts_[i];
  buf[0] = static_cast<double>(list.size());
  std::copy(list.begin(), list.end(), buf + 1);
  return static_cast<int>(list.size()) + 1;
}

int FixHistory::unpack_exchange(int nlocal, double *buf)
{
  const int n = static_cast<int>(buf[0]);
  contacts_[nlocal].assign(buf + 1, buf + 1 + n);
  return n + 1;
}

// its own length, the number of values of a contact, the contacts
int FixHistory::pack_restart(int i, double *buf)
{
  const std::vector<double> &list = contacts_[i];
  buf[0] = static_cast<double>(list.size() + 2);
  buf[1] = values_;
  std::copy(list.begin(), list.end(), buf + 2);
  return static_cast<int>(list.size()) + 2;
}

void FixHistory::unpack_restart(int nlocal, int nth)
{
  const double *stored = atom->extra[nlocal];
  for (int k = 0; k < nth; k++) stored += static_cast<int>(*stored);
  const int n = static_cast<int>(stored[0]) - 2;
  if (static_cast<int>(stored[1]) != values_)
    error->one(FLERR, "the restart file has {} values a contact, expected {}", stored[1], values_);
  contacts_[nlocal].assign(stored + 2, stored + 2 + n);
  maxexchange = std::max(maxexchange, n + 1);
}

int FixHistory::size_restart(int nlocal)
{
  return static_cast<int>(contacts_[nlocal].size()) + 2;
}

int FixHistory::maxsize_restart()
{
  return maxexchange + 1;
}

double FixHistory::memory_usage()
{
  double bytes = static_cast<double>(contacts_.capacity() * sizeof(contacts_[0]));
  for (const auto &list : contacts_) bytes += static_cast<double>(list.capacity() * sizeof(double));
  return bytes;
}
