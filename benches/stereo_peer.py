#!/usr/bin/env python3
"""Compares the time of `ocu eval stereo` and of OpenCV on one pair, alternately, one thread each.

Needs numpy and opencv-python-headless. Example:

  cargo build --release -p ocu
  python3 benches/stereo_peer.py --ocu target/release/ocu --left left.png --right right.png

The pair is cropped to 640x480 around its middle column; 64 disparities; left-right check of 1 pixel, uniqueness of
10 %, speckles of fewer than 100 pixels removed, in both.
"""

import argparse
import json
import pathlib
import statistics
import subprocess
import tempfile
import time

import cv2
import numpy as np

DISPARITIES = 64
ROUNDS = 7


def block_matching():
    """OpenCV's StereoBM with the same checks."""
    matcher = cv2.StereoBM_create(DISPARITIES, 9)
    matcher.setUniquenessRatio(10)
    matcher.setSpeckleWindowSize(100)
    matcher.setSpeckleRange(1)
    matcher.setDisp12MaxDiff(1)
    return matcher


def semi_global(mode):
    """OpenCV's StereoSGBM over 3x3 with its documentation's penalties and ours' checks."""
    return cv2.StereoSGBM_create(0, DISPARITIES, 3, 8 * 9, 32 * 9, 1, 63, 10, 100, 1, mode)


def peer_ms(matcher, left, right):
    """Median of 11 times, ms."""
    times = []
    for _ in range(11):
        start = time.perf_counter()
        matcher.compute(left, right)
        times.append((time.perf_counter() - start) * 1e3)
    return statistics.median(times)


def our_ms(ocu, method, left, right):
    """Median of 11 times, ms, as `ocu eval stereo` reports it."""
    command = [ocu, "eval", "stereo", "--left", left, "--right", right, "--method", method, "--json"]
    command += ["--disparities", str(DISPARITIES), "--threads", "1"]
    report = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    return json.loads(report)["ms_median"]


def main():
    """Prints one line for each pair of methods: ours, the peer's, ratio; medians over the rounds."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--ocu", required=True, help="the built program, release")
    parser.add_argument("--left", required=True, help="left image, at least 640x480")
    parser.add_argument("--right", required=True, help="right image")
    args = parser.parse_args()
    cv2.setNumThreads(1)
    images = []
    for path in (args.left, args.right):
        image = cv2.imread(path, cv2.IMREAD_GRAYSCALE)
        if image is None or image.shape[0] < 480 or image.shape[1] < 640:
            parser.error(f"{path} is no image of at least 640x480 pixels")
        column = (image.shape[1] - 640) // 2
        images.append(np.ascontiguousarray(image[:480, column : column + 640]))
    pairs = [
        ("bm", "StereoBM", block_matching()),
        ("sgm", "StereoSGBM", semi_global(cv2.STEREO_SGBM_MODE_SGBM)),
        ("sgm", "StereoSGBM, three-way", semi_global(cv2.STEREO_SGBM_MODE_SGBM_3WAY)),
    ]
    with tempfile.TemporaryDirectory() as folder:
        left, right = (str(pathlib.Path(folder) / name) for name in ("left.png", "right.png"))
        cv2.imwrite(left, images[0])
        cv2.imwrite(right, images[1])
        print(f"OpenCV {cv2.__version__}, 640x480, {DISPARITIES} disparities, one thread")
        for method, name, matcher in pairs:
            rounds = [(our_ms(args.ocu, method, left, right), peer_ms(matcher, *images)) for _ in range(ROUNDS)]
            ours, peer = (statistics.median(times) for times in zip(*rounds))
            print(f"{method:4} {ours:7.2f} ms   {name:22} {peer:7.2f} ms   ratio {ours / peer:.2f}")


if __name__ == "__main__":
    main()
