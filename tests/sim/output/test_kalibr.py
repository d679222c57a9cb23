import cv2
import numpy as np
import yaml

from navcore.calibration import Calibration, cameras_from_kalibr, imu_from_yaml
from sim.output.kalibr import write_kalibr
from tests.sim.output.recordings import NOISE, mounts


def test_it_reads_back(tmp_path):
    write_kalibr(tmp_path, Calibration(NOISE, mounts()))
    assert imu_from_yaml(tmp_path / "imu.yaml") == NOISE
    for got, wanted in zip(cameras_from_kalibr(tmp_path / "camchain-imucam.yaml"), mounts(), strict=True):
        assert got.camera == wanted.camera
        assert (got.rate_hz, got.dt_cam_imu) == (wanted.rate_hz, wanted.dt_cam_imu)
        np.testing.assert_allclose(got.T_BC, wanted.T_BC, atol=1e-15)


def test_it_has_kalibrs_words_and_the_chain_goes_from_camera_to_camera(tmp_path):
    write_kalibr(tmp_path, Calibration(NOISE, mounts()))
    chain = yaml.safe_load((tmp_path / "camchain-imucam.yaml").read_text())
    assert [c["camera_model"] for c in chain.values()] == ["pinhole", "pinhole"]
    assert [c["distortion_model"] for c in chain.values()] == ["radtan", "equidistant"]
    assert [c["rostopic"] for c in chain.values()] == ["/cam0/image_raw", "/cam1/image_raw"]
    assert "T_cn_cnm1" not in chain["cam0"]
    p_C0 = np.array([0.3, -0.2, 2.0, 1.0])  # a point that both say where they see it
    p_B = mounts()[0].T_BC @ p_C0
    np.testing.assert_allclose(np.array(chain["cam0"]["T_cam_imu"]) @ p_B, p_C0, atol=1e-15)
    p_C1 = np.array(chain["cam1"]["T_cam_imu"]) @ p_B
    np.testing.assert_allclose(np.array(chain["cam1"]["T_cn_cnm1"]) @ p_C0, p_C1, atol=1e-15)
    imu = yaml.safe_load((tmp_path / "imu.yaml").read_text())
    assert (imu["rostopic"], imu["update_rate"]) == ("/imu0", 200.0)


def test_without_cameras_there_is_no_chain(tmp_path):
    write_kalibr(tmp_path, Calibration(NOISE))
    assert [x.name for x in tmp_path.iterdir()] == ["imu.yaml"]


def test_opencv_reads_what_is_written(tmp_path):
    """OpenVINS reads its YAML with OpenCV, which is stricter than YAML."""
    calibration = Calibration(NOISE, mounts())
    write_kalibr(tmp_path, calibration)
    for name, key in (("camchain-imucam.yaml", "cam1"), ("imu.yaml", "gyroscope_noise_density")):
        storage = cv2.FileStorage(
            "%YAML:1.0\n" + (tmp_path / name).read_text(), cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY
        )
        assert not storage.getNode(key).empty()
    chain = "%YAML:1.0\n" + (tmp_path / "camchain-imucam.yaml").read_text()
    storage = cv2.FileStorage(chain, cv2.FILE_STORAGE_READ | cv2.FILE_STORAGE_MEMORY)
    pose = storage.getNode("cam1").getNode("T_cam_imu")
    rows = [[pose.at(i).at(j).real() for j in range(4)] for i in range(4)]
    np.testing.assert_allclose(rows @ calibration.cameras[1].T_BC, np.eye(4), atol=1e-9)
