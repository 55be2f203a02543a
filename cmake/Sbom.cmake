# Makes the bill of materials of this build as an SPDX 2.3 file in JSON. The file lists the program and the
# libraries that the build uses, with the versions that CMake found. UBS_SBOM is the path of the file.
set(UBS_SBOM ${PROJECT_BINARY_DIR}/ubs.spdx.json)
set(sbom_packages "")
set(sbom_relations "")
# Arguments: the name and the version of the library, and the licence under which its authors publish it.
function(ubs_sbom name version licence)
  if(NOT version)
    set(version NOASSERTION)
  endif()
  string(REGEX REPLACE "[^A-Za-z0-9.-]" "-" id "SPDXRef-${name}")
  string(CONFIGURE [[,
    {"SPDXID": "@id@", "name": "@name@", "versionInfo": "@version@", "downloadLocation": "NOASSERTION",
     "licenseDeclared": "@licence@", "filesAnalyzed": false}]] package @ONLY)
  string(CONFIGURE [[,
    {"spdxElementId": "SPDXRef-ubs", "relationshipType": "DEPENDS_ON", "relatedSpdxElement": "@id@"}]] relation @ONLY)
  set(sbom_packages "${sbom_packages}${package}" PARENT_SCOPE)
  set(sbom_relations "${sbom_relations}${relation}" PARENT_SCOPE)
endfunction()
# Versions of packages whose CMake files do not state a version.
if(UBS_OPENCL AND NOT CLBlast_VERSION)
  execute_process(COMMAND ${PKG_CONFIG_EXECUTABLE} --modversion clblast OUTPUT_VARIABLE CLBlast_VERSION
                  OUTPUT_STRIP_TRAILING_WHITESPACE ERROR_QUIET)
endif()
if(UBS_OPENCV AND NOT OpenCV_VERSION)
  find_file(opencv_version_header opencv2/core/version.hpp HINTS ${OpenCV_INCLUDE_DIRS} NO_CACHE)
  if(opencv_version_header)
    file(STRINGS ${opencv_version_header} parts REGEX "define CV_VERSION_(MAJOR|MINOR|REVISION)")
    list(TRANSFORM parts REPLACE ".* ([0-9]+)$" "\\1")
    list(JOIN parts "." OpenCV_VERSION)
  endif()
endif()
if(UBS_OPENCL)
  ubs_sbom(OpenCL "${OpenCL_VERSION_STRING}" "Apache-2.0")
  ubs_sbom(CLBlast "${CLBlast_VERSION}" "Apache-2.0")
endif()
if(UBS_OPENCV)
  ubs_sbom(OpenCV "${OpenCV_VERSION}" "Apache-2.0")
  ubs_sbom(libjpeg-turbo "${turbojpeg_VERSION}" "IJG AND BSD-3-Clause AND Zlib")
  ubs_sbom(libpng "${PNG_VERSION_STRING}" "libpng-2.0")
  ubs_sbom(libtiff "${TIFF_VERSION_STRING}" "libtiff")
  ubs_sbom(OpenEXR "${openexr_VERSION}" "BSD-3-Clause")
  ubs_sbom(FFmpeg "${libav_libavformat_VERSION}" "GPL-2.0-or-later")
  file(STRINGS ${UBS_CHART_JS} chart_version LIMIT_COUNT 1 REGEX "Chart.js v[0-9.]+")
  string(REGEX REPLACE ".*Chart.js v([0-9.]+).*" "\\1" chart_version "${chart_version}")
  ubs_sbom(Chart.js "${chart_version}" "MIT")
endif()
if(with_mpi)
  ubs_sbom(MPI "${MPI_C_VERSION}" "NOASSERTION")
endif()
if(UBS_WITH_CUDA)
  ubs_sbom(CUDA-runtime "${CUDAToolkit_VERSION}" "LicenseRef-NVIDIA-CUDA-EULA")
endif()
if(UBS_SERVE)
  ubs_sbom(cpp-httplib "${httplib_VERSION}" "MIT")
endif()
ubs_sbom(zlib "${ZLIB_VERSION_STRING}" "Zlib")
ubs_sbom(zstd "${zstd_VERSION}" "BSD-3-Clause")
ubs_sbom(yaml-cpp "${yaml-cpp_VERSION}" "MIT")
ubs_sbom(fmt "${fmt_VERSION}" "MIT")
ubs_sbom(nlohmann_json "${nlohmann_json_VERSION}" "MIT")
ubs_sbom(pugixml "${pugixml_VERSION}" "MIT")
ubs_sbom(nanoflann "${nanoflann_VERSION}" "BSD-2-Clause")
ubs_sbom(CLI11 "${CLI11_VERSION}" "BSD-3-Clause")
# string(TIMESTAMP) uses the time in the environment variable SOURCE_DATE_EPOCH if it is set.
string(TIMESTAMP sbom_time "%Y-%m-%dT%H:%M:%SZ" UTC)
string(UUID sbom_name NAMESPACE 6ba7b811-9dad-11d1-80b4-00c04fd430c8 NAME "ubs ${PROJECT_VERSION} ${sbom_packages}"
       TYPE SHA1)
file(CONFIGURE OUTPUT ${UBS_SBOM} @ONLY CONTENT [[{
  "spdxVersion": "SPDX-2.3",
  "dataLicense": "CC0-1.0",
  "SPDXID": "SPDXRef-DOCUMENT",
  "name": "ubs-@PROJECT_VERSION@",
  "documentNamespace": "urn:uuid:@sbom_name@",
  "creationInfo": {"created": "@sbom_time@", "creators": ["Tool: ubs-cmake"]},
  "packages": [
    {"SPDXID": "SPDXRef-ubs", "name": "ubs", "versionInfo": "@PROJECT_VERSION@", "downloadLocation": "NOASSERTION",
     "licenseDeclared": "Apache-2.0", "filesAnalyzed": false}@sbom_packages@
  ],
  "hasExtractedLicensingInfos": [
    {"licenseId": "LicenseRef-NVIDIA-CUDA-EULA", "name": "NVIDIA CUDA EULA",
     "extractedText": "https://docs.nvidia.com/cuda/eula/"}
  ],
  "relationships": [
    {"spdxElementId": "SPDXRef-DOCUMENT", "relationshipType": "DESCRIBES", "relatedSpdxElement": "SPDXRef-ubs"}@sbom_relations@
  ]
}
]])
