// A client of the image stream that takes the bytes and does not parse them, for bench/stream.py --native: with a Python
// client its own cost hides the server's.
//
//   g++ -O2 -std=c++17 bench/stream_client.cc -o stream_client $(pkg-config --cflags --libs grpc++)
//   stream_client HOST:PORT SECONDS PAUSE      gRPC
//   stream_client tcp:PORT SECONDS PAUSE       raw TCP on loopback: each set behind its length in 8 bytes

#include <arpa/inet.h>
#include <grpcpp/grpcpp.h>
#include <grpcpp/support/byte_buffer.h>
#include <grpcpp/support/sync_stream.h>
#include <sys/resource.h>
#include <sys/socket.h>

#include <algorithm>
#include <chrono>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <memory>
#include <string>
#include <thread>
#include <vector>

namespace {

double cpu() {
  rusage usage;
  getrusage(RUSAGE_SELF, &usage);
  return usage.ru_utime.tv_sec + usage.ru_stime.tv_sec + 1e-6 * (usage.ru_utime.tv_usec + usage.ru_stime.tv_usec);
}

double now() {
  return std::chrono::duration<double>(std::chrono::steady_clock::now().time_since_epoch()).count();
}

// Seconds since the timestamp in the first field of a set: Time{1: sec, 2: nsec} as varints.
double age(const grpc::ByteBuffer& buffer) {
  std::vector<grpc::Slice> slices;
  buffer.Dump(&slices);
  const unsigned char* data = slices[0].begin();
  double value[3] = {0, 0, 0};
  for (int i = 2, end = 2 + data[1]; i < end;) {
    const int field = data[i++] >> 3;
    unsigned long long number = 0;
    for (int shift = 0;; shift += 7) {
      number |= (data[i] & 0x7FULL) << shift;
      if (!(data[i++] & 0x80)) break;
    }
    if (field < 3) value[field] = static_cast<double>(number);
  }
  const auto system = std::chrono::system_clock::now().time_since_epoch();
  return std::chrono::duration<double>(system).count() - value[1] - 1e-9 * value[2];
}

// Sets over gRPC; a call gives the bytes of the next one and its age.
class Stream {
 public:
  explicit Stream(const std::string& target) {
    grpc::ChannelArguments arguments;
    arguments.SetMaxReceiveMessageSize(-1);
    channel_ = grpc::CreateCustomChannel(target, grpc::InsecureChannelCredentials(), arguments);
    // ImageSetRequest: left, right, disparity, error and confidence enabled.
    const grpc::Slice fields("\x08\x01\x10\x01\x18\x01\x20\x01\x28\x01", 10);
    const grpc::ByteBuffer request(&fields, 1);
    const grpc::internal::RpcMethod method("/ImageInterface/StreamImageSets",
                                           grpc::internal::RpcMethod::SERVER_STREAMING, channel_);
    reader_ = grpc::internal::ClientReaderFactory<grpc::ByteBuffer>::Create(channel_.get(), method, &context_, request);
  }
  bool next(double* bytes, double* old) {
    if (!reader_->Read(&buffer_)) return false;
    *bytes = static_cast<double>(buffer_.Length());
    *old = age(buffer_);
    return true;
  }

 private:
  std::shared_ptr<grpc::Channel> channel_;
  grpc::ClientContext context_;
  grpc::ClientReader<grpc::ByteBuffer>* reader_;
  grpc::ByteBuffer buffer_;
};

// Sets over a socket, each received into the same memory.
class Raw {
 public:
  explicit Raw(int port) : socket_(socket(AF_INET, SOCK_STREAM, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(static_cast<uint16_t>(port));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    if (connect(socket_, reinterpret_cast<sockaddr*>(&address), sizeof address) != 0) std::_Exit(1);
  }
  bool next(double* bytes, double* old) {
    uint64_t size = 0;
    if (!fill(reinterpret_cast<char*>(&size), sizeof size)) return false;
    data_.resize(size);
    *bytes = static_cast<double>(size);
    *old = 0;
    return fill(data_.data(), size);
  }

 private:
  bool fill(char* place, size_t left) {
    while (left > 0) {
      const ssize_t got = recv(socket_, place, left, 0);
      if (got <= 0) return false;
      place += got;
      left -= static_cast<size_t>(got);
    }
    return true;
  }
  int socket_;
  std::vector<char> data_;
};

template <typename Source>
[[noreturn]] void measure(Source& source, double seconds, double pause) {
  std::vector<double> ages;
  double begin = 0, cpu_begin = 0, bytes = 0, spent = 0, size = 0, old = 0;
  while (source.next(&size, &old)) {
    if (ages.empty()) {
      std::puts("started");
      std::fflush(stdout);
      begin = now();
      cpu_begin = cpu();
    }
    ages.push_back(old);
    bytes += size;
    spent = now() - begin;
    if (spent > seconds) break;
    if (pause > 0) std::this_thread::sleep_for(std::chrono::duration<double>(pause));
  }
  const double sets = static_cast<double>(ages.size());
  std::sort(ages.begin(), ages.end());
  std::printf("{\"sets\": %f, \"mb\": %f, \"cpu\": %f, \"age\": %f, \"slow\": %s}\n", (sets - 1) / spent,
              bytes * (sets - 1) / sets / spent / 1e6, (cpu() - cpu_begin) / spent, ages[ages.size() / 2] * 1e3,
              pause > 0 ? "true" : "false");
  std::fflush(stdout);
  std::_Exit(0);
}

}  // namespace

int main(int argc, char** argv) {
  if (argc < 4) return 2;
  const std::string target = argv[1];
  if (target.rfind("tcp:", 0) == 0) {
    Raw raw(std::atoi(target.c_str() + 4));
    measure(raw, std::atof(argv[2]), std::atof(argv[3]));
  }
  Stream stream(target);
  measure(stream, std::atof(argv[2]), std::atof(argv[3]));
}
