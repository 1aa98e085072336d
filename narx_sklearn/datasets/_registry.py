"""The files of the public data sets, where they come from, and the checksum of their content.

The digits of a column are those to which its content is compared, see `_files.content_sha256`.
"""

from types import MappingProxyType

import pandas as pd

from narx_sklearn.datasets._files import (
    DataFile,
    PathLike,
    load_file,
    read_csv,
    read_hdf5,
    read_loops,
    read_mat,
    read_single_columns,
)

__all__ = ["FILES", "load", "sources"]

# Repository and commit of every origin.
_SILVERBOX = ("biaslab/nsi-silverbox", "728f07e4539d4f7da76a4778b52a756260b488ac")
_NEURAL_CONTINUOUS = ("forgi86/sysid-neural-continuous", "956aa7ecd73061b0321c6f6098d74c9e4a7ce67a")
_LPV = ("gsmfnc/LPV_SysId", "a843d61efb1401308c932bd77b6653446bbdd351")
_DYNONET_TEST = ("forgi86/dynonet", "5350b4abc58b8142d0d5008dbc9c09b7e4356ca8")
_DYNONET_TRAIN = ("forgi86/dynonet", "56699401b141065a45403a18977333e0ec8d7303")
_DYNONET_F16 = ("forgi86/dynonet", "0bdf70605da2570cca526659b3b21e6356e7bb48")
_MR_DAMPER = (
    "Abhay3757/PSO-Optimized-Dual-Attention-LSTM-for-MR-Damper-Force-Prediction",
    "92619e4cfab281450627c7e6a6198113196e41a1",
)
_JILES_ATHERTON = ("romanszewczyk/JAmodel", "4bbe905d420ce27c66ee93d8b25ef44b553f9175")
_SYSIDENTPY_DATA = ("wilsonrljr/sysidentpy-data", "72715362eadcf860fdbd77d88b5d7e92b6143a83")
_DARKGREYBOX = ("czagoni/darkgreybox", "280a7cd5849ad1c109c7aca8b68c52f09f1ca3f3")

_SILVERBOX_COLUMNS = MappingProxyType({"V1 [V]": 9, "V2 [V]": 9})
_EMPS_COLUMNS = MappingProxyType({"t [s]": 10, "qm [m]": 12, "qg [m]": 12, "vir [V]": 10})
_EMPS_TEST_COLUMNS = MappingProxyType(
    {"t [s]": 10, "qm [m]": 12, "qg [m]": 12, "vir [V]": 10, "pulses [V]": 12}
)
_CASCADED_TANKS_COLUMNS = MappingProxyType({"u [V]": 5, "y [V]": 5})
_WIENER_HAMMERSTEIN_COLUMNS = MappingProxyType({"u [V]": 9, "y [V]": 9})
_BOUC_WEN_COLUMNS = MappingProxyType({"u [N]": 11, "y [m]": 11})
_F16_GVT_COLUMNS = MappingProxyType(
    {
        "Force [N]": 6,
        "Voltage [V]": 6,
        "Acc1_shaker [m/s^2?]": 6,
        "Acc2_wing [m/s^2?]": 6,
        "Acc3_payload [m/s^2?]": 6,
    }
)
_MR_DAMPER_NEES_COLUMNS = MappingProxyType({"D [cm]": 6, "V [cm/s]": 6, "Y [V]": 6, "F [N]": 8})
_BH_LOOPS_COLUMNS = MappingProxyType({"loop [-]": 9, "H [A/m]": 9, "B [T]": 9})
_DC_MOTOR_GENERATOR_COLUMNS = MappingProxyType({"u [V]": 6, "y [?]": 6})
_BUCK_CONVERTER_COLUMNS = MappingProxyType({"t [s]": 9, "u [V]": 9, "y [V]": 9})
_BUILDING_HEATING_COLUMNS = MappingProxyType({"Ph [kW]": 9, "Ta [degC]": 9, "Ti [degC]": 9, "Th [degC]": 9})

_ALL = (
    DataFile(
        "silverbox",
        "snls80mv",
        131072,
        "9c61ac24399ee9d0e07a8bf3a1a9820bbcdcc2728b42991c864cb550dca13442",
        _SILVERBOX_COLUMNS,
        _SILVERBOX,
        ("data/Silverbox/SNLS80mV.mat",),
        read_mat("V1", "V2"),
    ),
    DataFile(
        "silverbox",
        "schroeder80mv",
        131072,
        "1212d1a8856f6c29fd56fa8caa92e6160a73f3b7b15d0cce8f5e7839abf0f119",
        _SILVERBOX_COLUMNS,
        _SILVERBOX,
        ("data/Silverbox/Schroeder80mV.mat",),
        read_mat("V1", "V2"),
    ),
    DataFile(
        "emps",
        "estimation",
        24841,
        "e58f9538bb1a0c126e29d40bf229f6c6744b8c207eca4e4032953d2e3a531e66",
        _EMPS_COLUMNS,
        _NEURAL_CONTINUOUS,
        ("examples/EMPS/data/DATA_EMPS.mat",),
        read_mat("t", "qm", "qg", "vir"),
    ),
    DataFile(
        "emps",
        "test_pulses",
        24841,
        "4e968dc3eac2586245e312678a1d8f5d011fb18b09501141a871f4c762680089",
        _EMPS_TEST_COLUMNS,
        _NEURAL_CONTINUOUS,
        ("examples/EMPS/data/DATA_EMPS_PULSES.mat",),
        read_mat("t", "qm", "qg", "vir", "pulses_N"),
    ),
    DataFile(
        "cascaded_tanks",
        "estimation",
        1024,
        "c7fdde2c9f45950c31c8750572037f32920e67190e01302529fb6587b894a3b1",
        _CASCADED_TANKS_COLUMNS,
        _NEURAL_CONTINUOUS,
        ("examples/CTS/data/dataBenchmark.csv",),
        read_csv("uEst", "yEst"),
    ),
    DataFile(
        "cascaded_tanks",
        "test",
        1024,
        "659b11a12fc9c3d17439cbb002bc38b80d75d8f57ffb95f60b0f59d3e8ec74a1",
        _CASCADED_TANKS_COLUMNS,
        _NEURAL_CONTINUOUS,
        ("examples/CTS/data/dataBenchmark.csv",),
        read_csv("uVal", "yVal"),
    ),
    DataFile(
        "wiener_hammerstein",
        "full",
        188000,
        "be0412ad9df82d5553eed767ca44a66ccb9333c093c456989d5b8da7f32bb3b5",
        _WIENER_HAMMERSTEIN_COLUMNS,
        _LPV,
        ("noise_simulations/lpvcore/wiener_hammerstein/dataset/WienerHammerBenchMark.mat",),
        read_mat("uBenchMark", "yBenchMark"),
    ),
    DataFile(
        "bouc_wen",
        "test_multisine",
        8192,
        "cfb029ede8e83d971bc78f900f1082d5380980c0323c8fd8225cc854c6b1d9af",
        _BOUC_WEN_COLUMNS,
        _DYNONET_TEST,
        (
            "examples/BW/BoucWenFiles/Test signals/Validation signals/uval_multisine.mat",
            "examples/BW/BoucWenFiles/Test signals/Validation signals/yval_multisine.mat",
        ),
        read_mat("uval_multisine", "yval_multisine"),
    ),
    DataFile(
        "bouc_wen",
        "test_sinesweep",
        153000,
        "0551f4a875afce08a454b29e3c9f24e2a0f049d288320727d1ecfba3b4ce4054",
        _BOUC_WEN_COLUMNS,
        _DYNONET_TEST,
        (
            "examples/BW/BoucWenFiles/Test signals/Validation signals/uval_sinesweep.mat",
            "examples/BW/BoucWenFiles/Test signals/Validation signals/yval_sinesweep.mat",
        ),
        read_mat("uval_sinesweep", "yval_sinesweep"),
    ),
    DataFile(
        "bouc_wen",
        "train_multisine",
        40960,
        "dd4328302ddebaf49db9a6719868226c52884e7337ece6285e1abb8d07008ed6",
        _BOUC_WEN_COLUMNS,
        _DYNONET_TRAIN,
        ("examples/BW/data/Test signals/train.h5",),
        read_hdf5("multisine/u", "multisine/y"),
    ),
    DataFile(
        "f16_gvt",
        "fullmsine_level1_est",
        73728,
        "296d9f07cbd89f6b228ad9e44072deee71a4774328645e47dbe9bf9b7cf34c15",
        _F16_GVT_COLUMNS,
        _DYNONET_F16,
        ("examples/F16GVT/data/BenchmarkData/F16Data_FullMSine_Level1.mat",),
        read_mat("Force", "Voltage", "Acceleration"),
    ),
    DataFile(
        "f16_gvt",
        "fullmsine_level2_test",
        73728,
        "e0b611b8a4e199fccfd2e4ed0947e95a097a61dcfda7ef52f3e66345d233310f",
        _F16_GVT_COLUMNS,
        _DYNONET_F16,
        ("examples/F16GVT/data/BenchmarkData/F16Data_FullMSine_Level2_Validation.mat",),
        read_mat("Force", "Voltage", "Acceleration"),
    ),
    DataFile(
        "f16_gvt",
        "fullmsine_level3_est",
        73728,
        "7744e7ce5487d46882fc36ec20089fff4a95a5d38ca0db4eedd570af174a3e95",
        _F16_GVT_COLUMNS,
        _DYNONET_F16,
        ("examples/F16GVT/data/BenchmarkData/F16Data_FullMSine_Level3.mat",),
        read_mat("Force", "Voltage", "Acceleration"),
    ),
    DataFile(
        "f16_gvt",
        "fullmsine_level4_test",
        73728,
        "258cbb98129a22f28bf98c7a320c65bca9147c3abf1fa8c9c363b296fb99755b",
        _F16_GVT_COLUMNS,
        _DYNONET_F16,
        ("examples/F16GVT/data/BenchmarkData/F16Data_FullMSine_Level4_Validation.mat",),
        read_mat("Force", "Voltage", "Acceleration"),
    ),
    DataFile(
        "f16_gvt",
        "fullmsine_level5_est",
        73728,
        "aaf9077178050cfa8b5adcd235f66a20f190b21ac4297c10572388b556ac49c9",
        _F16_GVT_COLUMNS,
        _DYNONET_F16,
        ("examples/F16GVT/data/BenchmarkData/F16Data_FullMSine_Level5.mat",),
        read_mat("Force", "Voltage", "Acceleration"),
    ),
    DataFile(
        "f16_gvt",
        "fullmsine_level6_test",
        73728,
        "01b6085e51db74ffacf4cd00260356ba7ce2cc3ad2609e647a3d8da71f115a26",
        _F16_GVT_COLUMNS,
        _DYNONET_F16,
        ("examples/F16GVT/data/BenchmarkData/F16Data_FullMSine_Level6_Validation.mat",),
        read_mat("Force", "Voltage", "Acceleration"),
    ),
    DataFile(
        "f16_gvt",
        "fullmsine_level7_est",
        73728,
        "622a9ed5062e2e85beb1f0ffff9a4538d7f699ffdee31f4366973f9e26478f5d",
        _F16_GVT_COLUMNS,
        _DYNONET_F16,
        ("examples/F16GVT/data/BenchmarkData/F16Data_FullMSine_Level7.mat",),
        read_mat("Force", "Voltage", "Acceleration"),
    ),
    DataFile(
        "f16_gvt",
        "sinesw_level1_est",
        108477,
        "89fa742645074c68417c813c0c4190d9ef556bc207baff1be55561c663402962",
        _F16_GVT_COLUMNS,
        _DYNONET_F16,
        ("examples/F16GVT/data/BenchmarkData/F16Data_SineSw_Level1.mat",),
        read_mat("Force", "Voltage", "Acceleration"),
    ),
    DataFile(
        "f16_gvt",
        "sinesw_level2_test",
        108477,
        "f725f9e95e589e0a17271dbe8abaf668323e90f899ae85a6eb0fe43f592b426f",
        _F16_GVT_COLUMNS,
        _DYNONET_F16,
        ("examples/F16GVT/data/BenchmarkData/F16Data_SineSw_Level2_Validation.mat",),
        read_mat("Force", "Voltage", "Acceleration"),
    ),
    DataFile(
        "f16_gvt",
        "sinesw_level3_est",
        108477,
        "c45f062c6851667147a055c5bd3043fca6fa97442bdb3d7e508be543626c9e72",
        _F16_GVT_COLUMNS,
        _DYNONET_F16,
        ("examples/F16GVT/data/BenchmarkData/F16Data_SineSw_Level3.mat",),
        read_mat("Force", "Voltage", "Acceleration"),
    ),
    DataFile(
        "mr_damper_nees",
        "ranran_50",
        74068,
        "c61769b5aa70d1328f95699a22fdeb4813dee807eb29ddf74208da65a18ebcc0",
        _MR_DAMPER_NEES_COLUMNS,
        _MR_DAMPER,
        ("Dataset/ranran_50_converted.csv",),
        read_csv("D", "V", "Y", "F"),
    ),
    DataFile(
        "mr_damper_nees",
        "ransim_u",
        60096,
        "0c1751691a9c4da3ddfcbdf7f93bcaf628fdc149b8ba6ee914abd4af039237e0",
        _MR_DAMPER_NEES_COLUMNS,
        _MR_DAMPER,
        ("Dataset/ransim_u_converted.csv",),
        read_csv("D", "V", "Y", "F"),
    ),
    DataFile(
        "bh_loops",
        "mnzn_ferrite",
        516,
        "fb1008788f6a76472200c23ad9cefa6d46ea2f5a7b661c386e5cc731f334d7aa",
        _BH_LOOPS_COLUMNS,
        _JILES_ATHERTON,
        (
            "12_Automation2018/Characterisitcs_isotropic_mat/H_MnZn_ferrite.mat",
            "12_Automation2018/Characterisitcs_isotropic_mat/B_MnZn_ferrite.mat",
        ),
        read_loops,
    ),
    DataFile(
        "bh_loops",
        "mnzn_hp_ferrite",
        516,
        "badbbfa61ec80561ae1381b96101143f001cfccd65dd6ee808dc22b7828d7c29",
        _BH_LOOPS_COLUMNS,
        _JILES_ATHERTON,
        (
            "11_TwoStepSolver/Characteristics_isotropic_mat/H_MnZn_HP_ferrite.mat",
            "11_TwoStepSolver/Characteristics_isotropic_mat/B_MnZn_HP_ferrite.mat",
        ),
        read_loops,
    ),
    DataFile(
        "bh_loops",
        "amorphous_alloy",
        322,
        "ffc43eaa0566b8dcc5445467b8fcf34aadc3f34db6f5879d36cba297c0ab869f",
        _BH_LOOPS_COLUMNS,
        _JILES_ATHERTON,
        (
            "2_anisotropic/Characterisitcs_anisotropic_mat/H_amorf.mat",
            "2_anisotropic/Characterisitcs_anisotropic_mat/B_amorf.mat",
        ),
        read_loops,
    ),
    DataFile(
        "bh_loops",
        "m130_27s_steel",
        768,
        "fe243b48a1aafa3de7c29412083feb2d3084168e597ade5610e7ba54b4907117",
        _BH_LOOPS_COLUMNS,
        _JILES_ATHERTON,
        (
            "3_mixed/Characterisitcs_mixed_mat/H_M130_27s.mat",
            "3_mixed/Characterisitcs_mixed_mat/B_M130_27s.mat",
        ),
        read_loops,
    ),
    DataFile(
        "dc_motor_generator",
        "full",
        500000,
        "5414ff90cdcc82773dc72f1e974f2eaff4ba498357aa3a9acdffe3c98b1ed49a",
        _DC_MOTOR_GENERATOR_COLUMNS,
        _SYSIDENTPY_DATA,
        (
            "datasets/generator/x_cc.csv",
            "datasets/generator/y_cc.csv",
        ),
        read_single_columns,
    ),
    DataFile(
        "buck_converter",
        "estimation",
        1001,
        "a638974b9ca8a127cca675af6288d623b7a2e2a7eddd6ef677c5f92a3af7602b",
        _BUCK_CONVERTER_COLUMNS,
        _SYSIDENTPY_DATA,
        ("datasets/buck/buck_id.csv",),
        read_csv("sampling_time", "input", "y"),
    ),
    DataFile(
        "buck_converter",
        "test",
        999,
        "ad1a2b0c59cae0e823f58c43cf5ceebee955da6b41d9511ed6d5726cc34e43e4",
        _BUCK_CONVERTER_COLUMNS,
        _SYSIDENTPY_DATA,
        ("datasets/buck/buck_valid.csv",),
        read_csv("sampling_time", "input", "y"),
    ),
    DataFile(
        "building_heating",
        "full",
        792,
        "659ad872d674dc785e7b724c67d65a3af98676ee0c73c1cc353518f1833f022f",
        _BUILDING_HEATING_COLUMNS,
        _DARKGREYBOX,
        ("docs/tutorials/data/demo_data.csv",),
        read_csv("Ph", "Ta", "Ti", "Th"),
    ),
)

FILES = MappingProxyType({(file.dataset, file.part): file for file in _ALL})


def load(dataset: str, part: str, data_home: PathLike) -> pd.DataFrame:
    """Return one record, verified."""
    return load_file(FILES[dataset, part], data_home)


def sources(dataset: str, *parts: str) -> tuple[str, ...]:
    """Return the addresses of the original files of the parts, each once."""
    return tuple(dict.fromkeys(url for part in parts for url in FILES[dataset, part].urls))
