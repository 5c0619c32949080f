// SPDX-License-Identifier: Apache-2.0
// Times MRPT's COccupancyGridMap2D with simple rays; built and called by benchmarks/lidar2d.py.
//
//   mrpt_simple SCANS.bin REPEATS [GRID.bin]
//
// SCANS.bin, little-endian: int64 scans, beams; float64 resolution, x_min, x_max, y_min, y_max,
// middle angle and aperture of the fan [rad]; then for each scan float64 x, y, theta and beams
// float32 ranges [m], 0 where there is no return. One line of seconds of pure insertion for each
// repeat. GRID.bin: int64 columns, rows; float64 x_min, y_min; float32 p(occupied), row by row.

#include <mrpt/maps/COccupancyGridMap2D.h>
#include <mrpt/obs/CObservation2DRangeScan.h>
#include <mrpt/poses/CPose3D.h>

#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <memory>
#include <optional>
#include <vector>

using mrpt::maps::COccupancyGridMap2D;
using mrpt::obs::CObservation2DRangeScan;
using mrpt::poses::CPose3D;

struct Header {
    std::int64_t scans, beams;
    double resolution, x_min, x_max, y_min, y_max, middle, aperture;
};

static std::unique_ptr<COccupancyGridMap2D> empty_map(const Header& head) {
    // Made as large as it will get: growing is not in MRPT's time.
    auto map = std::make_unique<COccupancyGridMap2D>(
        head.x_min, head.x_max, head.y_min, head.y_max, head.resolution);
    auto& options = map->insertionOptions;
    options.wideningBeamsWithDistance = false;         // simple rays (the default)
    options.decimation = 1;                            // every beam (the default)
    options.maxDistanceInsertion = 1000.0f;            // no beam is cut short (default 15 m)
    options.maxOccupancyUpdateCertainty = 0.65f;       // the default; free cells get 0.35
    options.considerInvalidRangesAsFreeSpace = false;  // no return clears nothing, as in oddsmap
    return map;
}

static void write_grid(const COccupancyGridMap2D& map, const char* path) {
    std::ofstream out(path, std::ios::binary);
    const std::int64_t size[2] = {map.getSizeX(), map.getSizeY()};
    const double corner[2] = {map.getXMin(), map.getYMin()};
    out.write(reinterpret_cast<const char*>(size), sizeof size);
    out.write(reinterpret_cast<const char*>(corner), sizeof corner);
    std::vector<float> row(size[0]);
    for (std::int64_t y = 0; y < size[1]; ++y) {
        for (std::int64_t x = 0; x < size[0]; ++x) row[x] = 1.0f - map.getCell(x, y);
        out.write(reinterpret_cast<const char*>(row.data()), row.size() * sizeof(float));
    }
}

int main(int argc, char** argv) {
    if (argc < 3) return 2;
    std::ifstream in(argv[1], std::ios::binary);
    Header head;
    if (!in.read(reinterpret_cast<char*>(&head), sizeof head)) return 1;
    std::vector<CObservation2DRangeScan> scans(head.scans);
    std::vector<CPose3D> poses(head.scans);
    std::vector<float> ranges(head.beams);
    std::vector<char> valid(head.beams);
    for (std::int64_t i = 0; i < head.scans; ++i) {
        double pose[3];
        in.read(reinterpret_cast<char*>(pose), sizeof pose);
        if (!in.read(reinterpret_cast<char*>(ranges.data()), head.beams * sizeof(float))) return 1;
        for (std::int64_t k = 0; k < head.beams; ++k) valid[k] = ranges[k] > 0;
        poses[i] = CPose3D(pose[0], pose[1], 0, pose[2], 0, 0);
        scans[i].aperture = static_cast<float>(head.aperture);
        scans[i].maxRange = 1000.0f;
        scans[i].sensorPose = CPose3D(0, 0, 0, head.middle, 0, 0);
        scans[i].loadFromVectors(head.beams, ranges.data(), valid.data());
    }
    for (int repeat = std::atoi(argv[2]); repeat > 0; --repeat) {
        const auto map = empty_map(head);
        const auto started = std::chrono::steady_clock::now();
        for (std::int64_t i = 0; i < head.scans; ++i) {
            std::optional<CPose3D> pose(poses[i]);
            if (!map->insertObservation(scans[i], pose)) return 1;
        }
        const std::chrono::duration<double> took = std::chrono::steady_clock::now() - started;
        std::printf("%.9f\n", took.count());
        if (repeat == 1 && argc > 3) write_grid(*map, argv[3]);
    }
    return 0;
}
