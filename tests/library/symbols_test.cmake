# Tests that the library contains no symbols of the float64 oracle, the accuracy measurements, the benchmarks or the
# stress tests. Run it with cmake -DNM=... -DLIBRARY=... -P symbols_test.cmake
execute_process(COMMAND ${NM} ${LIBRARY} OUTPUT_VARIABLE symbols COMMAND_ERROR_IS_FATAL ANY)
if(NOT symbols MATCHES "3ubs5check")
  message(FATAL_ERROR "${LIBRARY} has no symbols of ubs::check: it is stripped, or was built without the device check")
endif()
if(symbols MATCHES "3ubs(6oracle|8accuracy|5bench|6stress)")
  message(FATAL_ERROR "${LIBRARY} has symbols of ubs::${CMAKE_MATCH_1}")
endif()
