# Tests that the library contains no symbols of the float64 reference or of the code that measures ubs: cmake
# -DNM=... -DLIBRARY=... -P
execute_process(COMMAND ${NM} ${LIBRARY} OUTPUT_VARIABLE symbols COMMAND_ERROR_IS_FATAL ANY)
if(NOT symbols MATCHES "3ubs5check")
  message(FATAL_ERROR "${LIBRARY} is stripped, or has no check of devices")
endif()
if(symbols MATCHES "3ubs(6oracle|8accuracy|5bench|6stress)")
  message(FATAL_ERROR "${LIBRARY} has symbols of ubs::${CMAKE_MATCH_1}")
endif()
