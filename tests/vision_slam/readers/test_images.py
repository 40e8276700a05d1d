"""Image files that phones extend after their end, and those that are cut off."""

import io

import cv2
import numpy as np
import pytest
from PIL import Image

from survey.core.errors import InputError
from survey.data.camera import Camera
from vision_slam.readers.images import images_of, refuse_cut_off_image, refuse_other_sizes
from vision_slam.readers.photos import read_photo

PIXELS = np.random.default_rng(1).integers(0, 255, (24, 32), dtype=np.uint8)
TRAILERS = {
    "samsung": b"\x00\x00\x01\x0a\x0e\x00\x00\x00Image_UTC_Data1718187302123SEFH" + bytes(32) + b"SEFT",
    "motion photo": b"\x00\x00\x00\x18ftypmp42" + bytes(2000),
}


def content_of(kind, **options):
    stream = io.BytesIO()
    Image.fromarray(PIXELS).save(stream, kind, **options)
    return stream.getvalue()


@pytest.mark.parametrize("trailer", TRAILERS.values(), ids=TRAILERS)
@pytest.mark.parametrize("progressive", [False, True])
def test_jpeg_images_may_be_followed_by_other_data(tmp_path, trailer, progressive):
    (tmp_path / "a.jpg").write_bytes(content_of("JPEG", progressive=progressive) + trailer)
    assert images_of([tmp_path / "a.jpg"])[0].shape == PIXELS.shape


def test_a_jpeg_image_without_its_end_is_refused_even_with_a_small_image_in_its_exif(tmp_path):
    exif = b"Exif\x00\x00" + content_of("JPEG")
    content = content_of("JPEG", quality=95)
    segment = b"\xff\xe1" + (len(exif) + 2).to_bytes(2, "big") + exif
    (tmp_path / "a.jpg").write_bytes(content[:2] + segment + content[2:-200])
    with pytest.raises(InputError, match=r"a\.jpg is cut off"):
        refuse_cut_off_image(tmp_path / "a.jpg")


def test_an_image_that_lacks_a_part_is_named(tmp_path):
    content = content_of("PNG")
    (tmp_path / "a.png").write_bytes(content[:300])
    with pytest.raises(InputError, match=r"a\.png is damaged or no image that can be read .* get it again"):
        read_photo(tmp_path / "a.png")


@pytest.mark.parametrize("suffix", ["pgm", "tif"])
@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
def test_an_image_of_another_size_among_many_is_named(tmp_path, suffix, depth):
    files = [tmp_path / f"{k}.{suffix}" for k in range(3)]
    for file, pixels in zip(files, (PIXELS, PIXELS, PIXELS[:, :20]), strict=True):
        cv2.imwrite(str(file), pixels.astype(depth))
    camera = Camera("pinhole", 32, 24, np.diag([30.0, 30.0, 1.0]), np.zeros(5), np.eye(4))
    refuse_other_sizes(files[:2], camera)
    with pytest.raises(InputError, match=rf"2\.{suffix} has 20 × 24 pixels, its calibration 32 × 24"):
        refuse_other_sizes(files, camera)
