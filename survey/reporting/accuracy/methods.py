"""Methods and standards that reports cite."""

NSSDA = "FGDC (1998): Geospatial Positioning Accuracy Standards, Part 3: National Standard for Spatial Data Accuracy. FGDC-STD-007.3-1998."
ASPRS_2014 = "ASPRS (2014): Positional Accuracy Standards for Digital Geospatial Data, Edition 1, Version 1.0. Photogrammetric Engineering & Remote Sensing 81(3), A1–A26."
ASPRS_EDITION_2 = (
    "ASPRS (2024): Positional Accuracy Standards for Digital Geospatial Data, Edition 2, Version 2."
)
ASPRS_1990 = "ASPRS (1990): Accuracy Standards for Large-Scale Maps."
NMAS = "US Bureau of the Budget (1947): United States National Map Accuracy Standards."
HOEHLE = "Höhle, J., Höhle, M. (2009): Accuracy assessment of digital elevation models by means of robust statistical methods. ISPRS Journal of Photogrammetry and Remote Sensing 64(4), 398–406. doi:10.1016/j.isprsjprs.2009.02.003 (median, NMAD, quantiles)."
ROLSTAD = "Rolstad, C., Haug, T., Denby, B. (2009): Spatially integrated geodetic glacier mass balance and its uncertainty based on geostatistical analysis. Journal of Glaciology 55(192), 666–680 (errors of averages with correlated errors)."
HUSS = "Huss, M. (2013): Density assumptions for converting geodetic glacier volume change to mass change. The Cryosphere 7, 877–887."
NUTH = "Nuth, C., Kääb, A. (2011): Co-registration and bias corrections of satellite elevation data sets for quantifying glacier thickness change. The Cryosphere 5, 271–290."

BY_STANDARD = {
    "nssda-1998": NSSDA,
    "asprs-2014": ASPRS_2014,
    "asprs-edition-2": ASPRS_EDITION_2,
    "asprs-1990-spot-heights": ASPRS_1990,
    "asprs-1990-contours": ASPRS_1990,
    "nmas-1947": NMAS,
}
"""Citation of each standard that judges checkpoints."""
