"""The tags of our files (TIFF 6.0, Exif 2.3, DNG 1.4), and the values that go with them."""

from enum import IntEnum

from ..pattern import PANCHROMATIC

MAKER = "Panchroma"

DNG_VERSION = bytes([1, 4, 0, 0])
DNG_VERSION_OF_ILLUMINANT_DATA = bytes([1, 6, 0, 0])
DNG_BACKWARD_VERSION = bytes([1, 2, 0, 0])  # a reader of DNG 1.2 can show the file

# The longest period of a CFA and of black levels that Adobe's SDK supports (kMaxCFAPattern, kMaxBlackPattern).
LONGEST_CFA_PERIOD = 8

# Rows or columns of one JPEG: JPEG_MAX_DIMENSION of libjpeg.
LONGEST_SIDE = 65500

# Codes of colours in CFAPattern and CFAPlaneColor.
CFA_CODES = {"R": 0, "G": 1, "B": 2, "C": 3, "M": 4, "Y": 5, PANCHROMATIC: 6}

PICTURE_PLANES = 3  # of a rendered picture: red, green, blue
PREVIEW_SRGB = 2  # PreviewColorSpace


class Tag(IntEnum):
    """TIFF tags by number."""

    # The picture of a directory
    NEW_SUBFILE_TYPE = 254  # LONG; 0 = the main picture, 1 = a smaller one of the same scene
    IMAGE_WIDTH = 256
    IMAGE_LENGTH = 257
    BITS_PER_SAMPLE = 258
    COMPRESSION = 259
    PHOTOMETRIC = 262
    ORIENTATION = 274  # 1..8, of samples and preview; displays apply it, the samples are never rotated
    SAMPLES_PER_PIXEL = 277
    ROWS_PER_STRIP = 278
    X_RESOLUTION = 282
    Y_RESOLUTION = 283
    PLANAR_CONFIG = 284
    RESOLUTION_UNIT = 296
    TILE_WIDTH = 322
    TILE_LENGTH = 323
    SUB_IFDS = 330  # LONG, not IFD: older readers know no type 13
    YCBCR_SUBSAMPLING = 530
    YCBCR_POSITIONING = 531
    REFERENCE_BLACK_WHITE = 532

    # Who, what, when
    IMAGE_DESCRIPTION = 270
    MAKE = 271
    MODEL = 272
    XMP = 700
    SOFTWARE = 305
    DATE_TIME = 306
    ARTIST = 315
    COPYRIGHT = 33432

    # Exif
    EXIF_IFD = 34665
    EXPOSURE_TIME = 33434  # seconds
    F_NUMBER = 33437
    ISO_SPEED_RATINGS = 34855  # SHORT: 65535 when ISO_SPEED holds more
    SENSITIVITY_TYPE = 34864
    ISO_SPEED = 34867
    EXIF_VERSION = 36864
    DATE_TIME_ORIGINAL = 36867
    OFFSET_TIME = 36880  # of DATE_TIME
    OFFSET_TIME_ORIGINAL = 36881
    FOCAL_LENGTH = 37386  # millimetres
    SUB_SEC_TIME = 37520  # of DATE_TIME
    SUB_SEC_TIME_ORIGINAL = 37521  # decimal digits after the second
    LENS_MODEL = 42036
    GPS_IFD = 34853

    # Raw samples
    CFA_REPEAT_PATTERN_DIM = 33421  # rows, columns
    CFA_PATTERN = 33422  # CFA_CODES, row by row, from the first pixel of the picture
    CFA_PLANE_COLOR = 50710  # CFA_CODES in the order of all per-plane values
    CFA_LAYOUT = 50711  # 1 = rectangular
    BLACK_LEVEL_REPEAT_DIM = 50713
    BLACK_LEVEL = 50714  # codes
    WHITE_LEVEL = 50717  # the code that reads full scale
    NOISE_PROFILE = 51041  # S, O per plane: variance = S x + O at x = signal / full scale

    # Camera
    DNG_VERSION = 50706
    DNG_BACKWARD_VERSION = 50707
    UNIQUE_CAMERA_MODEL = 50708
    COLOR_MATRIX_1 = 50721  # XYZ -> camera, a row per plane, under illuminant 1
    COLOR_MATRIX_2 = 50722  # XYZ -> camera, a row per plane, under illuminant 2
    AS_SHOT_NEUTRAL = 50728  # reading of white, a value per plane
    BASELINE_EXPOSURE = 50730  # EV that a converter adds for a normally bright picture
    DNG_PRIVATE_DATA = 50740
    RAW_DATA_UNIQUE_ID = 50781  # 16 bytes
    CALIBRATION_ILLUMINANT_1 = 50778
    CALIBRATION_ILLUMINANT_2 = 50779
    PREVIEW_COLOR_SPACE = 50970
    NEW_RAW_IMAGE_DIGEST = 51111
    ILLUMINANT_DATA_1 = 52533  # DNG 1.6: SHORT 0, then two RATIONALs: CIE x, y
    ILLUMINANT_DATA_2 = 52534


class GpsTag(IntEnum):
    """Tags of the GPS directory."""

    VERSION = 0
    LATITUDE_REF = 1  # N or S
    LATITUDE = 2  # degrees, minutes, seconds
    LONGITUDE_REF = 3  # E or W
    LONGITUDE = 4
    ALTITUDE_REF = 5  # BYTE; 1 = below the sea
    ALTITUDE = 6  # metres


class Compression(IntEnum):
    """Values of COMPRESSION. Lossless JPEG is the only compression of samples that every raw developer decodes."""

    NONE = 1
    JPEG = 7  # lossless for raw samples, baseline for the preview


class Photometric(IntEnum):
    """Values of PHOTOMETRIC."""

    YCBCR = 6
    CFA = 32803  # one colour per pixel, as CFA_PATTERN says
    LINEAR_RAW = 34892  # every plane at every pixel, linear


class Light(IntEnum):
    """Values of CalibrationIlluminant, which are those of LightSource in Exif."""

    A = 17
    D55 = 20
    D65 = 21
    D75 = 22
    D50 = 23
    OTHER = 255  # as ILLUMINANT_DATA says
