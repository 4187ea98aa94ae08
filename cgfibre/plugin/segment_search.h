// Pairs of segments that come near each other: every segment is cut into pieces no longer than the typical segment, the
// pieces go into a grid of cells, and pieces of neighbouring cells are tested by their segments' least distance.

#ifndef CGFIBRE_SEGMENT_SEARCH_H
#define CGFIBRE_SEGMENT_SEARCH_H

#include <cstddef>
#include <cstdint>
#include <utility>
#include <vector>

namespace cgfibre {

struct SearchSegment {
  int bead;          // index of the first bead
  int molecule;      // of the filament; segments of one filament are never paired
  bool owned;        // its pairs are asked for (as the first)
  double from[3], to[3], radius;
};

class SegmentSearch {
 public:
  // calls found(a, b): segments (indices into the list) of different molecules, a owned, whose axes come nearer than their
  // radii and the skin, the pairs of one a in a row; every pair once, molecule(a) < molecule(b), or (`both`) either way
  template <class Found> void pairs(const std::vector<SearchSegment> &, double skin, bool both, Found found);

 private:
  struct Piece {
    int64_t cell;
    int segment;
    bool operator<(const Piece &o) const { return cell != o.cell ? cell < o.cell : segment < o.segment; }
  };
  std::vector<Piece> pieces;
  std::vector<int> last;    // segment that a segment was last tested against
  double low[3], size[3];
  int64_t count[3];

  void sort_into_cells(const std::vector<SearchSegment> &, double skin);
  void cell_of(const double *, int64_t *) const;
  int cuts(const SearchSegment &) const;
  double piece_length;
};

// square of the least distance of the segments p1-q1 and p2-q2 (Ericson, Real-Time Collision Detection, 5.1.9)
double segment_distance2(const double *p1, const double *q1, const double *p2, const double *q2);

template <class Found>
void SegmentSearch::pairs(const std::vector<SearchSegment> &segments, double skin, bool both, Found found)
{
  if (segments.empty()) return;
  sort_into_cells(segments, skin);
  last.assign(segments.size(), -1);
  for (int a = 0; a < (int) segments.size(); a++) {
    const SearchSegment &one = segments[a];
    if (!one.owned) continue;
    const int n = cuts(one);
    for (int k = 0; k < n; k++) {
      double middle[3];
      int64_t c[3];
      for (int d = 0; d < 3; d++) middle[d] = one.from[d] + (k + 0.5) / n * (one.to[d] - one.from[d]);
      cell_of(middle, c);
      // cells of a row along x follow one another
      for (int64_t z = c[2] - 1; z <= c[2] + 1; z++)
        for (int64_t y = c[1] - 1; y <= c[1] + 1; y++) {
          if (y < 0 || z < 0 || y >= count[1] || z >= count[2]) continue;
          const int64_t row = (z * count[1] + y) * count[0];
          const int64_t first = row + (c[0] > 0 ? c[0] - 1 : 0);
          const int64_t end = row + (c[0] + 1 < count[0] ? c[0] + 1 : count[0] - 1);
          std::size_t lo = 0, hi = pieces.size();
          while (lo < hi) {
            const std::size_t mid = (lo + hi) / 2;
            if (pieces[mid].cell < first)
              lo = mid + 1;
            else
              hi = mid;
          }
          for (; lo < pieces.size() && pieces[lo].cell <= end; lo++) {
            const int b = pieces[lo].segment;
            const SearchSegment &other = segments[b];
            if (other.molecule == one.molecule || (!both && other.molecule < one.molecule) || last[b] == a) continue;
            last[b] = a;
            const double reach = one.radius + other.radius + skin;
            if (segment_distance2(one.from, one.to, other.from, other.to) < reach * reach) found(a, b);
          }
        }
    }
  }
}

}    // namespace cgfibre

#endif
