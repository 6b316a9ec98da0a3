# cmake -S . -B build-arm --toolchain cmake/arm-none-eabi.cmake [-DCANROLL_CPU=cortex-m0]
set(CMAKE_SYSTEM_NAME Generic)
set(CMAKE_SYSTEM_PROCESSOR arm)
set(CMAKE_C_COMPILER arm-none-eabi-gcc)
# nothing to link against: a bare machine
set(CMAKE_TRY_COMPILE_TARGET_TYPE STATIC_LIBRARY)
set(CANROLL_CPU cortex-m4 CACHE STRING "Processor, as arm-none-eabi-gcc calls it")
list(APPEND CMAKE_TRY_COMPILE_PLATFORM_VARIABLES CANROLL_CPU)
set(CMAKE_C_FLAGS_INIT "-mcpu=${CANROLL_CPU} -mthumb -mfloat-abi=soft -ffreestanding")
